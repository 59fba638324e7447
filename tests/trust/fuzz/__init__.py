"""Throws damaged and hostile input at every reader: whatever it is, there is a result or one line of an error.

readers: what is fed with bytes. structures: inputs with the form of each format, by hypothesis. run: the long program, by
hypothesis or by atheris, which is led by coverage. test_fuzz: a short run, and the cases that were once found.
"""
