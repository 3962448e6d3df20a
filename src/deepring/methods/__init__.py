"""Place-recognition methods behind one small protocol."""
