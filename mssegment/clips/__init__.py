"""Long clips: frames are read once, and segmented window by window, in bounded memory."""
