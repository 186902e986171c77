"""Speed and accuracy beside named peers."""
