"""Tables and figures of Han 2018: monocular obstacle detection and swarm search."""
