"""What this installation and machine are, whether commands can work here, and what is slow."""
