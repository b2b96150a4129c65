"""Questions about numbers of a scene that are hardly meant as they are said."""
