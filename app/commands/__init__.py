"""The commands of irrsplat, a file for each: its flags, what is checked before the work, and the call of that work.

All of these files are imported for every command line. So they import libraries, and the work, only in functions: --help and
mistakes are told at once, and a library that is missing hinders its own command alone.
"""
