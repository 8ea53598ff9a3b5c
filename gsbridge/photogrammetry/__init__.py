"""What several stages of Real2Sim measure with: board and tags, COLMAP models, outlines of objects, carved solids."""
