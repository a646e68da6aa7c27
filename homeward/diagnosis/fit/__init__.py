"""What the known physics explains: windows, replay, and the groups of parameters fitted to them."""
