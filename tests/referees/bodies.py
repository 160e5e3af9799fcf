"""Naive bodies of planar faces with integer vertices: hulls, prisms, and exact decisions."""

from fractions import Fraction
from itertools import combinations

import numpy as np


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def minus(a, b):
    return tuple(x - y for x, y in zip(a, b))


class Body:
    """Vertices, and faces as rings of their indices, counterclockwise seen from outside."""

    def __init__(self, vertices, faces):
        self.vertices, self.faces = [tuple(map(int, vertex)) for vertex in vertices], faces

    def ring(self, face):
        return [self.vertices[number] for number in face]

    def plane(self, face):
        """Returns the outer normal of a face, as long as twice its area, and its dot product with
        the face's points."""
        ring = self.ring(face)
        normal = (0, 0, 0)
        for a, b in zip(ring, ring[1:] + ring[:1]):
            normal = tuple(n + c for n, c in zip(normal, cross(a, b)))
        return normal, dot(normal, ring[0])

    def triangles(self, face):
        """Cuts off ears of a face until three vertices are left."""
        ring, (normal, _) = list(face), self.plane(face)
        found = []
        while len(ring) > 3:
            for at in range(len(ring)):
                corner = [ring[at - 1], ring[at], ring[(at + 1) % len(ring)]]
                a, b, c = (self.vertices[number] for number in corner)
                turn = dot(cross(minus(b, a), minus(c, b)), normal)
                others = [self.vertices[number] for number in ring if number not in corner]
                if turn > 0 and not any(all(dot(cross(minus(q, p), minus(other, p)), normal) >= 0 for p, q in ((a, b), (b, c), (c, a))) for other in others):
                    break
            found.append([self.vertices[number] for number in corner])
            ring.pop(at)
        return [*found, [self.vertices[number] for number in ring]]

    def all_triangles(self):
        return [triangle for face in self.faces for triangle in self.triangles(face)]

    def edges(self):
        return {tuple(sorted(pair)) for face in self.faces for pair in zip(face, [*face[1:], face[0]])}

    def volume(self):
        return sum(Fraction(dot(a, cross(b, c)), 6) for a, b, c in self.all_triangles())

    def area(self):
        return sum(float(np.sqrt(float(dot(n, n)))) / 2 for n, _ in map(self.plane, self.faces))

    def locate(self, point):
        """Returns where a point is, by the faces that a ray into a direction without symmetry
        crosses."""
        direction, winding = (1009, 10007, 100003), 0
        for a, b, c in self.all_triangles():
            a, b, c = (minus(vertex, point) for vertex in (a, b, c))
            height = dot(a, cross(b, c))
            normal = cross(minus(b, a), minus(c, a))
            if height == 0:
                if all(dot(cross(p, q), normal) >= 0 for p, q in ((a, b), (b, c), (c, a))):
                    return "boundary"
                continue
            sides = [dot(direction, cross(p, q)) for p, q in ((a, b), (b, c), (c, a))]
            slope = dot(direction, normal)
            assert slope == 0 or 0 not in sides, "a ray through an edge"
            if (min(sides) > 0 or max(sides) < 0) and height * slope > 0:
                winding += 1 if slope > 0 else -1
        return "inside" if winding > 0 else "outside"


def hull(points):
    """Returns the convex hull: all planes through three points that have no points on one side."""
    points = sorted({tuple(map(int, point)) for point in points})
    faces = {}
    for a, b, c in combinations(range(len(points)), 3):
        normal = cross(minus(points[b], points[a]), minus(points[c], points[a]))
        if not any(normal):
            continue
        sides = [dot(normal, minus(point, points[a])) for point in points]
        for sign in (1, -1):
            if all(sign * side <= 0 for side in sides):
                outer = tuple(sign * at for at in normal)
                on = tuple(number for number, side in enumerate(sides) if side == 0)
                faces[on] = around(points, on, outer)
    used = sorted({number for face in faces.values() for number in face})
    return Body([points[number] for number in used], [[used.index(number) for number in face] for face in faces.values()])


def around(points, on, normal):
    """Returns the corners of points in a plane, counterclockwise about the normal."""

    def is_edge(a, b):
        sides = [dot(cross(minus(points[b], points[a]), minus(points[c], points[a])), normal) for c in on]
        far = [c for c, side in zip(on, sides) if side == 0 and dot(minus(points[c], points[b]), minus(points[b], points[a])) > 0]
        between = [c for c, side in zip(on, sides) if side == 0 and dot(minus(points[c], points[a]), minus(points[c], points[b])) <= 0]
        return all(side >= 0 for side in sides) and not far and len(between) >= 2

    following = {}
    for a in on:
        for b in on:
            if a != b and is_edge(a, b) and dot(minus(points[b], points[a]), minus(points[b], points[a])) > dot(
                minus(points[following.get(a, a)], points[a]), minus(points[following.get(a, a)], points[a])
            ):
                following[a] = b
    start = next(b for b in following.values() if b in following)
    ring = [start]
    while following[ring[-1]] != start:
        ring.append(following[ring[-1]])
    return ring


def prism(ring, low, high):
    """Returns the body over a counterclockwise ring in x and y."""
    count = len(ring)
    vertices = [(x, y, z) for z in (low, high) for x, y in ring]
    sides = [[at, (at + 1) % count, (at + 1) % count + count, at + count] for at in range(count)]
    return Body(vertices, [list(range(count))[::-1], list(range(count, 2 * count)), *sides])


def box(low, high):
    return prism([(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])], low[2], high[2])


def cuts(triangle, low, high, is_closed):
    """Returns whether a triangle has points in a box, with or without the box's surface, by
    clipping it to one side of the box after the other."""
    polygon = [tuple(map(Fraction, vertex)) for vertex in triangle]
    for axis in range(3):
        for sign, bound in ((1, low[axis]), (-1, -high[axis])):
            heights = [sign * vertex[axis] - bound for vertex in polygon]
            clipped = []
            for at in range(len(polygon)):
                a, b, h, k = polygon[at - 1], polygon[at], heights[at - 1], heights[at]
                if h * k < 0:
                    clipped.append(tuple(p + (q - p) * h / (h - k) for p, q in zip(a, b)))
                if k >= 0:
                    clipped.append(b)
            polygon = clipped
    if is_closed or not polygon:
        return bool(polygon)
    middle = [sum(vertex[axis] for vertex in polygon) / len(polygon) for axis in range(3)]
    return all(least < at < most for least, at, most in zip(low, middle, high))


def pair_length(first, second):
    """Returns the length of the segment that two convex rings share, on the line of their planes:
    its direction is the product of the normals, and a point of it solves both equations with one
    coordinate 0."""
    rings = [np.array(first, float), np.array(second, float)]
    normals = [sum(np.cross(a, b) for a, b in zip(ring, np.roll(ring, -1, 0))) for ring in rings]
    normals = [normal / np.linalg.norm(normal) for normal in normals]
    direction = np.cross(*normals)
    if np.linalg.norm(direction) < 1e-12:
        return 0.0
    zero = int(np.argmax(np.abs(direction)))
    rest = [axis for axis in range(3) if axis != zero]
    start = np.zeros(3)
    start[rest] = np.linalg.solve([normal[rest] for normal in normals], [normal @ ring[0] for normal, ring in zip(normals, rings)])
    direction /= np.linalg.norm(direction)
    low, high = -np.inf, np.inf
    for ring, normal in zip(rings, normals):
        for a, b in zip(ring, np.roll(ring, -1, 0)):
            inner = np.cross(normal, b - a)
            height, slope = inner @ (start - a), inner @ direction
            if abs(slope) < 1e-12:
                if height < 0:
                    return 0.0
            elif slope > 0:
                low = max(low, -height / slope)
            else:
                high = min(high, -height / slope)
    return max(high - low, 0.0)
