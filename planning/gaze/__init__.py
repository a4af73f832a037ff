"""Where to look while walking.

`sweep` is the first policy: look where the next steps go, glance left and right in between, and do not
lose sight of what moves.

Source: seed 003, section 5 (head command); the order of glances is ours.
"""
