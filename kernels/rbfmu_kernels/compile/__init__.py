"""How kernels are compiled: one at a time, over arrays, several numbers side by side."""
