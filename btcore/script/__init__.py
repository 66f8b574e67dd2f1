"""The scripting language of BehaviorTree.CPP: lexer, parser and compiled scripts."""
