"""The book's controllers, which compute commands from sensor data without a tree."""
