"""What other programs are sent in their own formats."""
