"""Convert documents from XML format 3 (BehaviorTree.CPP 3) to format 4; unaffected text keeps its bytes."""
