"""The words everybody uses: frozen values with their algebra; they import nothing of ours.

Read `errors`, `pose`, `camera`, `gaussian`, `plane`, `obstacle`, `landmark`, then `frame`, which joins
them into one instant of the sensors.
"""
