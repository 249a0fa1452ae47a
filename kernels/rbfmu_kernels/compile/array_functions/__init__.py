"""Array functions made from kernels: tiles of items in columns, or plain `guvectorize` where Numba's inside differs."""
