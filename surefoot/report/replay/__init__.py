"""The replay page: one HTML file in which a slider moves everything a run knew at a moment.

Read `page` (the page and its limit of size), then `gathering` (the moments that are kept), `columns` (what the page
draws of each), `figures` (values and time series), `surroundings` (maps and cloud of the whole run) and `still` (the
page without scripts). `entry` is one moment for the live page, which is the same page. Script and style are the other
files of this folder, in the order of `page.SCRIPTS`; they use no library. Ours.
"""
