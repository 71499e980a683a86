"""The bundled machines: published compressors as scene files, every value with its source."""
