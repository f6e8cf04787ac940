"""The cell controller: reads a decision table and executes it; standard library and msgpack, never numpy."""
