"""What tools show of an FMU beside its model description: picture, pages, licences, terminals, groups of variables.

None of it changes what an FMU computes, and its identity does not rest on it.
"""
