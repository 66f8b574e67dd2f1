"""The scripting language of BehaviorTree.CPP: lexer, parser, and programs that run."""
