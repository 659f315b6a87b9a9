"""What any stage made, in any format."""
