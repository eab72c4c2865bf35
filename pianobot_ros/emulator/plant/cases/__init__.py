"""What one emulated cell is: its effects, their sizes and laws, drawn or given."""
