"""How records come to hold light: what they are gathered by, and how they follow what changes."""
