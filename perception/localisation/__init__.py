"""Where am I, where are they, and how sure.

Read `models` (what the walker's filter believes of the world), `tag_edges` and `landmarks` (tags in the
picture to range and bearing), `filter` (the robot's pose), `relocation` (the same from nothing), `scan`,
`keyframes` and `registration` (the same in a home without any marker, in this order), `track`
(one obstacle), `obstacles` (all of them, from frame to frame), and `consistency` (whether these
covariances can be believed).

Source: seed 001, sections 2, 3 and 14.
"""
