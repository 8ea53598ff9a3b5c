"""Tools that several stages of Real2Sim share: board and tags, COLMAP models, outlines of objects, carved solids."""
