"""Long sequences: windows of frames, and the identities of the motions through all windows.

``lifetimes`` chooses windows from how fast tracks end, ``short_tracks`` labels the tracks that are
too short to be segmented, and ``identities`` joins the motions of neighbouring windows.
"""
