"""What the dispatcher is asked, written down and done again."""
