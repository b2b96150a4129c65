"""What a SID is, and how all is stored. Imports nothing of the other packages."""
