"""The book's perception: objects and obstacles from sensor data."""
