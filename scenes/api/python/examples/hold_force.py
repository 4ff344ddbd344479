"""A controller in a loop with what is felt: a finger holds 0.5 N on a table that rises and falls under it.

    python3 hold_force.py [wanted newtons]
"""
import math
import sys

import palpate

wanted = float(sys.argv[1]) if len(sys.argv) > 1 else 0.5
world = palpate.build([{"name": "index", "pose": [0, 0, 0.009, 1, 0, 0, 0]}], [{"name": "table", "shape": "plane"}])
finger, table = world.fingers["index"], world.objects["table"]
height, worst = 0.009, 0.0
print("  time s  table mm  finger mm  force N")
for k in range(2000):
    table.pose = [0, 0, 0.001 * math.sin(math.pi * world.time), 1, 0, 0, 0]
    height += 2e-5 * max(-1, min(1, 4 * (finger.force[2] - wanted)))  # 20 mm/s at most
    finger.pose = [0, 0, height, 1, 0, 0, 0]
    world.step()
    if k >= 1000:
        worst = max(worst, abs(finger.force[2] - wanted))
    if k % 200 == 199:
        print(f"{world.time:8.3f} {1e3 * table.pose[2]:9.3f} {1e3 * height:10.3f} {finger.force[2]:8.3f}")
print(f"in the second second the force was within {worst:.3f} N of {wanted} N")
