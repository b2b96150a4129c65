"""Forces, laws and joint friction of a scene as tables."""
