"""Writes mvc_reference.h: mean value coordinates of five polytopes at twenty points, computed with 50 digits.

    python3 tests/mvc_reference.py > tests/mvc_reference.h        (needs mpmath)

Nothing is shared with the library: values come from the formula of Ju, Schaefer and Warren (2005) with 80 digits, their
gradients from differences of these over 1e-20. All coordinates are sums of few powers of 2, exact in float."""
from math import atan2
from mpmath import mp, mpf, sqrt, asin, sin, sign

mp.dps = 80


def sub(a, b): return [x - y for x, y in zip(a, b)]
def dot(a, b): return sum(x * y for x, y in zip(a, b))
def cross(a, b): return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def values(nodes, triangles, x):
    w = [mpf(0)] * len(nodes)
    for t in triangles:
        d = [sub(nodes[i], x) for i in t]
        r = [sqrt(dot(v, v)) for v in d]
        u = [[c / s for c in v] for v, s in zip(d, r)]
        side = []
        for i in range(3):
            e = sub(u[(i + 1) % 3], u[(i + 2) % 3])
            side.append(sqrt(dot(e, e)))
        th = [2 * asin(s / 2) for s in side]
        h = sum(th) / 2
        c = [2 * sin(h) * sin(h - th[i]) / (sin(th[(i + 1) % 3]) * sin(th[(i + 2) % 3])) - 1 for i in range(3)]
        turn = sign(dot(u[0], cross(u[1], u[2])))
        s = [turn * sqrt(1 - v * v) for v in c]
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            w[t[i]] += (th[i] - c[j] * th[k] - c[k] * th[j]) / (r[i] * sin(th[j]) * s[k])
    total = sum(w)
    return [v / total for v in w]


def gradients(nodes, triangles, x):
    step, columns = mpf(10) ** -20, []
    for axis in range(3):
        up, down = list(x), list(x)
        up[axis] += step
        down[axis] -= step
        columns.append([(a - b) / (2 * step) for a, b in zip(values(nodes, triangles, up), values(nodes, triangles, down))])
    return [list(row) for row in zip(*columns)]


def fans(faces): return [[f[0], f[i], f[i + 1]] for f in faces for i in range(1, len(f) - 1)]


CUBE = [[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)]
SIDES = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]]


def truncated_cube():
    xi = mpf(13) / 32
    nodes = []
    for axis in range(3):
        for s in range(8):
            p = [1 if s >> k & 1 else -1 for k in range(3)]
            p[axis] = xi * p[axis]
            nodes.append(p)
    faces = []
    for axis in range(3):
        for s in (-1, 1):
            ring = [i for i, p in enumerate(nodes) if p[axis] == s]
            a, b = (axis + 1) % 3, (axis + 2) % 3
            ring.sort(key=lambda i: s * atan2(float(nodes[i][b]), float(nodes[i][a])))
            faces.append(ring)
    for s in range(8):
        corner = [i for i, p in enumerate(nodes) if all((p[k] > 0) == bool(s >> k & 1) for k in range(3))]
        n = cross(sub(nodes[corner[1]], nodes[corner[0]]), sub(nodes[corner[2]], nodes[corner[0]]))
        faces.append(corner if dot(n, nodes[corner[0]]) > 0 else corner[::-1])
    return nodes, fans(faces)


def polytopes():
    yield ('tetrahedron', [[0, 0, 0], [2, 0.25, 0], [0.5, 1.5, 0.125], [0.25, 0.5, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
           [[0.5, 0.5, 0.25], [1, 0.5, 0.25], [0.625, 0.5625, 0.5], [0.375, 0.5, 0.8125]])
    yield ('octahedron', [[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0], [0, 0, -1.5]],
           [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]],
           [[0, 0, 0], [0.25, 0.125, 0.125], [0.5, 0.375, 0.0625], [-0.0625, 0.0625, -1.25]])
    bent = [list(p) for p in CUBE] + [[0.5, 0, 0]]  # a moved corner bends three sides; a node hangs on an edge
    bent[7] = [1.125, 0.9375, 1.0625]
    bent_sides = [list(s) for s in SIDES]
    bent_sides[2] = [8, 1, 5, 4, 0]
    bent_sides[4] = [8, 0, 2, 3, 1]
    yield ('bent cube with a hanging node', bent, fans(bent_sides),
           [[0.5, 0.5, 0.5], [0.875, 0.75, 0.875], [0.5, 0.03125, 0.0625], [0.0078125, 0.5, 0.25]])
    thin = mpf(2) ** -20
    yield ('slab of thickness 2^-20', [[p[0], p[1], p[2] * thin] for p in CUBE], fans(SIDES),
           [[0.5, 0.5, thin / 2], [0.25, 0.625, thin / 4], [0.96875, 0.5, thin / 8], [0.125, 0.125, 7 * thin / 8]])
    nodes, triangles = truncated_cube()
    yield ('truncated cube', nodes, triangles,
           [[0, 0, 0], [0.5, -0.25, 0.375], [0.875, 0.125, -0.75], [-0.75, -0.75, 0.9375]])


def main():
    print('/* Mean value coordinates of five polytopes at twenty points, by tests/mvc_reference.py with 50 digits. */')
    print('#ifndef MVC_REFERENCE_H\n#define MVC_REFERENCE_H\n')
    print('typedef struct mvc_reference {\n    const char *name;\n    int node_count, triangle_count;\n    double nodes[24][3];')
    print('    int triangles[44][3];\n    double points[4][3];\n    double values[4][24][4]; /* phi, d/dx, d/dy, d/dz */')
    print('} mvc_reference;\n\nstatic const mvc_reference mvc_references[5] = {')
    number = lambda v: mp.nstr(mpf(v), 20, min_fixed=-4, max_fixed=8, strip_zeros=True)
    row = lambda v, how=number: '{' + ', '.join(how(c) for c in v) + '}'
    for name, nodes, triangles, points in polytopes():
        nodes = [[mpf(c) for c in p] for p in nodes]
        print('    {"%s",\n     %d,\n     %d,' % (name, len(nodes), len(triangles)))
        for title, rows, how in (('nodes', nodes, number), ('triangles', triangles, str), ('points', points, number)):
            print('     {' + ',\n      '.join(row(r, how) for r in rows) + '},')
        blocks = []
        for x in points:
            x = [mpf(c) for c in x]
            phi, slope = values(nodes, triangles, x), gradients(nodes, triangles, x)
            blocks.append('{' + ',\n       '.join(row([p] + g) for p, g in zip(phi, slope)) + '}')
        print('     {' + ',\n      '.join(blocks) + '}},')
    print('};\n\n#endif')


main()
