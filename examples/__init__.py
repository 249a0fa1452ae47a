"""Examples, benchmarks, the gallery and interop scripts: `python -m examples.FOLDER.NAME` from the clone."""
