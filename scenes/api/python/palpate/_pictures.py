"""A world as notebooks show it."""
import html

import numpy


def page(world):
    """Each pad from below, coloured by contact pressure, with what it feels; below them the offline report in a frame."""
    most = max([1e3, *(float(f.pressures.max(initial=0)) for f in world.fingers)])
    cells = "".join(f"<td style='text-align:center'>{_pad_picture(f, most)}<br/>{html.escape(f.name)}<br/>{numpy.linalg.norm(f.force):.3f} N, "
                    f"{1e6 * f.area:.1f} mm&sup2;</td>" for f in world.fingers)  # fmt: skip
    objects = ", ".join(f"{html.escape(o.name)} at ({', '.join(f'{1e3 * x:.1f}' for x in o.pose[:3])}) mm" for o in world.objects)
    return (f"<p>palpate at {world.time:.4f} s; red is {1e-3 * most:.1f} kPa</p><table><tr>{cells}</tr></table><p>{objects}</p>"
            f"<iframe style='width:100%;height:32em;border:0' srcdoc='{html.escape(world.report(), quote=True)}'></iframe>")  # fmt: skip


def _pad_picture(finger, most):
    """An SVG of the pad, seen from where it touches, in the frame of its bone: no other library is needed."""
    places, faces, pressures = finger.rest_nodes[finger.sample_nodes], finger.faces, finger.pressures
    across, along = 1e3 * places[:, 1], -1e3 * places[:, 0]
    left, top = across.min() - 1, along.min() - 1
    width, height = across.max() + 1 - left, along.max() + 1 - top
    shapes = []
    for face in faces[numpy.argsort(-places[faces][:, :, 2].mean(axis=1))]:  # those below are nearest
        share = min(1.0, float(pressures[face].mean()) / most)
        colour = f"rgb({235 - int(30 * share)},{205 - int(175 * share)},{185 - int(155 * share)})"
        points = " ".join(f"{across[k] - left:.2f},{along[k] - top:.2f}" for k in face)
        shapes.append(f"<polygon points='{points}' fill='{colour}' stroke='#a88' stroke-width='.05'/>")
    return f"<svg width='{6 * width:.0f}' height='{6 * height:.0f}' viewBox='0 0 {width:.2f} {height:.2f}'>{''.join(shapes)}</svg>"
