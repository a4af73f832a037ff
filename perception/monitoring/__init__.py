"""What is wrong with the measurements, noticed from the measurements alone.

`clock` follows the stamps, `pictures` looks at the images, `agreement` compares measurements of the same thing, and
`status` joins what they say into the status of a frame. Source: ours.
"""
