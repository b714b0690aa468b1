"""demonstrations."""
