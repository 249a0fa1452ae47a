"""The native kind of FMU, which needs nothing: object code of the kernels below a C layer."""
