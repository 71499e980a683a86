"""Heat transfer between gas and wall, one correlation a file."""
