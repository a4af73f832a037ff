"""The replay page: one HTML file in which a slider moves everything a run knew at a moment.

Read `page` (the page and its limit of size), then `gathering` (the moments that are kept), `columns` (what the page
draws of each), `figures` (values and time series), `surroundings` (maps and cloud of the whole run) and `still` (the
page without scripts). Script and style are the other files of this folder; they use no library. Ours.
"""
