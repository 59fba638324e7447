"""Commands of irrsplat, one file each: flags, checks, and the call of the work.

Every command line imports all of these files. They import libraries and the work only in functions: --help and errors are
immediate, and a missing library affects only its own command.
"""
