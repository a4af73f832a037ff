"""The report of a run.

Read `page` first (assembly of the HTML page), then `cards` (figures at its top), `sections` (its parts) and
`plots` (pictures). `replay` is its page with a time slider;
`live_view` serves the same page for a run that still goes on.
"""
