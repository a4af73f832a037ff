"""The report of a run.

Read `page` first (assembly of the HTML page), then `cards` (figures at its top), `sections` (its parts) and
`plots` (pictures). `live_view` is the 3-D page of a running or finished run.
"""
