"""The reference: which moving objects an image shows, and the polygon of each.

Annotation -> lidar points on the object -> where they were at exposure -> pixels -> bounding polygon -> occlusion.
Its records, and the words of the protocol, are in `bench.records`.

Source:
    Mariotti and Eising, section IV-B: moving objects are annotated in the lidar point cloud and projected into the
    image, where a bounding reference polygon is generated.
"""
