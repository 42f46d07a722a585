"""Three small scenes to try the tool on, and the program that made them."""
