"""What a SID is, and how everything is stored. Imports nothing of the other packages."""
