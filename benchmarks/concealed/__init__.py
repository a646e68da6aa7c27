"""Physics concealed in plants of our own, and how often the diagnosis finds it."""
