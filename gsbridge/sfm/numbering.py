"""Numbers of the images in a COLMAP database, made independent of the order in which threads finish.

Threads that find features write each image when they are done with it, and its number follows from that order. Matching,
mapping and the random choices in both depend on the numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2  # noqa: F401  (must be loaded before pycolmap)
import pycolmap


def number_images(database: Path, names: Sequence[str]) -> None:
    """Rewrite a database of features with its images numbered from 1 in the order of `names`, as one thread would number them.

    Args:
        database: Cameras, images, one frame for each image, keypoints and descriptors; no matches yet.
        names: Names of all its images.

    Raises:
        ValueError: The database lacks one of the images.
    """
    fresh = database.with_suffix(".numbered")
    fresh.unlink(missing_ok=True)
    source, target = pycolmap.Database.open(database), pycolmap.Database.open(fresh)
    try:
        for camera in sorted(source.read_all_cameras(), key=lambda item: int(item.camera_id)):
            target.write_camera(camera, use_camera_id=True)
        for rig in sorted(source.read_all_rigs(), key=lambda item: int(item.rig_id)):
            target.write_rig(rig, use_rig_id=True)
        rigs = {int(frame.frame_id): frame.rig_id for frame in source.read_all_frames()}
        for number, name in enumerate(names, 1):
            old = source.read_image_with_name(name)
            if old is None:
                raise ValueError(f"the database holds no image {name}")
            image = pycolmap.Image(name=name, camera_id=old.camera_id, image_id=number)
            target.write_image(image, use_image_id=True)
            frame = pycolmap.Frame()
            frame.frame_id, frame.rig_id = number, rigs[int(old.frame_id)]
            frame.add_data_id(image.data_id)
            target.write_frame(frame, use_frame_id=True)
            target.write_keypoints(number, source.read_keypoints(old.image_id))
            target.write_descriptors(number, source.read_descriptors(old.image_id))
    finally:
        source.close()
        target.close()
    fresh.replace(database)
