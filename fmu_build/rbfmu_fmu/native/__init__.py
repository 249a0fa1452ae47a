"""The native kind of FMU, which needs nothing else in the importer: object code of the kernels under a C layer."""
