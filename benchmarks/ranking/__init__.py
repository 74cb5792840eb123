"""Does the lidar reference rank methods as the truth does, and how many beams does it need for that?"""
