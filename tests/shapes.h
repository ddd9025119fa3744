/* Polyhedra for tests and benchmarks: include it after dgfem.h. */
#ifndef SHAPES_H
#define SHAPES_H

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { SHAPE_VERTICES = 4096, SHAPE_FACES = 8192, SHAPE_CORNERS = 32768 };

/* Grows by shape_vertex, shape_face (which opens a face) and shape_loop (which adds a loop to it). */
typedef struct shape {
    int vertex_count, face_count, loop_count, corner_count;
    dgfem_vec3 vertices[SHAPE_VERTICES];
    int face_loops[SHAPE_FACES + 1], loop_start[SHAPE_FACES + 1], loop_vertices[SHAPE_CORNERS];
} shape;

static inline void shape_begin(shape *s) { memset(s, 0, sizeof *s); }

static inline int shape_vertex(shape *s, double x, double y, double z) {
    dgfem_vec3 *v = &s->vertices[s->vertex_count];
    if (s->vertex_count == SHAPE_VERTICES) abort();
    v->x = (dgfem_real)x, v->y = (dgfem_real)y, v->z = (dgfem_real)z;
    return s->vertex_count++;
}

static inline void shape_face(shape *s) {
    if (s->face_count == SHAPE_FACES) abort();
    s->face_loops[++s->face_count] = s->loop_count;
}

static inline void shape_loop(shape *s, const int *vertices, int count) {
    if (s->loop_count == SHAPE_FACES || s->corner_count + count > SHAPE_CORNERS) abort();
    memcpy(s->loop_vertices + s->corner_count, vertices, (size_t)count * sizeof(int));
    s->corner_count += count;
    s->loop_start[++s->loop_count] = s->corner_count;
    s->face_loops[s->face_count] = s->loop_count;
}

static inline void shape_triangle(shape *s, int a, int b, int c) {
    const int loop[3] = {a, b, c};
    shape_face(s);
    shape_loop(s, loop, 3);
}

static inline void shape_quad(shape *s, int a, int b, int c, int d) {
    const int loop[4] = {a, b, c, d};
    shape_face(s);
    shape_loop(s, loop, 4);
}

static inline dgfem_polyhedron_desc shape_desc(const shape *s) {
    dgfem_polyhedron_desc desc = dgfem_default_polyhedron_desc();
    desc.vertices = s->vertices, desc.vertex_count = s->vertex_count;
    desc.face_count = s->face_count, desc.face_loops = s->face_loops;
    desc.loop_start = s->loop_start, desc.loop_vertices = s->loop_vertices;
    return desc;
}

static inline dgfem_polyhedron *shape_polyhedron(const shape *s) {
    dgfem_polyhedron_desc desc = shape_desc(s);
    dgfem_polyhedron *polyhedron;
    if (dgfem_polyhedron_create(&desc, &polyhedron)) abort();
    return polyhedron;
}

/* x := m x + t, applied to all vertices. */
static inline void shape_transform(shape *s, const double m[3][3], const double t[3]) {
    int v;
    for (v = 0; v < s->vertex_count; v++) {
        const double x = (double)s->vertices[v].x, y = (double)s->vertices[v].y, z = (double)s->vertices[v].z;
        s->vertices[v].x = (dgfem_real)(m[0][0] * x + m[0][1] * y + m[0][2] * z + t[0]);
        s->vertices[v].y = (dgfem_real)(m[1][0] * x + m[1][1] * y + m[1][2] * z + t[1]);
        s->vertices[v].z = (dgfem_real)(m[2][0] * x + m[2][1] * y + m[2][2] * z + t[2]);
    }
}

/* Turns every loop round. */
static inline void shape_reverse(shape *s) {
    int l, i;
    for (l = 0; l < s->loop_count; l++)
        for (i = 0; i < (s->loop_start[l + 1] - s->loop_start[l]) / 2; i++) {
            int *a = &s->loop_vertices[s->loop_start[l] + i], *b = &s->loop_vertices[s->loop_start[l + 1] - 1 - i];
            const int swap = *a;
            *a = *b, *b = swap;
        }
}

/* Adds all of another shape. */
static inline void shape_append(shape *s, const shape *other) {
    const int base = s->vertex_count;
    int v, f, l, i;
    for (v = 0; v < other->vertex_count; v++)
        shape_vertex(s, (double)other->vertices[v].x, (double)other->vertices[v].y, (double)other->vertices[v].z);
    for (f = 0; f < other->face_count; f++) {
        shape_face(s);
        for (l = other->face_loops[f]; l < other->face_loops[f + 1]; l++) {
            const int first = s->corner_count;
            shape_loop(s, other->loop_vertices + other->loop_start[l], other->loop_start[l + 1] - other->loop_start[l]);
            for (i = first; i < s->corner_count; i++) s->loop_vertices[i] += base;
        }
    }
}

/* ---- solids ---- */

/* The prism between the heights z0 < z1 over a region of the plane: outer loops counter-clockwise, holes clockwise;
   xy[2 * i] of loop l for loop_start[l] <= i < loop_start[l + 1]. Two caps and one quadrilateral for each edge. */
static inline void shape_prism(shape *s, const double *xy, const int *loop_start, int loops, double z0, double z1) {
    const int n = loop_start[loops];
    int lower[1024], i, l;
    shape_begin(s);
    for (i = 0; i < n; i++) shape_vertex(s, xy[2 * i], xy[2 * i + 1], z0);
    for (i = 0; i < n; i++) shape_vertex(s, xy[2 * i], xy[2 * i + 1], z1);
    shape_face(s);
    for (l = 0; l < loops; l++) {
        const int count = loop_start[l + 1] - loop_start[l];
        for (i = 0; i < count; i++) lower[i] = loop_start[l + 1] - 1 - i;
        shape_loop(s, lower, count);
    }
    shape_face(s);
    for (l = 0; l < loops; l++) {
        const int count = loop_start[l + 1] - loop_start[l];
        for (i = 0; i < count; i++) lower[i] = n + loop_start[l] + i;
        shape_loop(s, lower, count);
    }
    for (l = 0; l < loops; l++)
        for (i = loop_start[l]; i < loop_start[l + 1]; i++) {
            const int next = i + 1 < loop_start[l + 1] ? i + 1 : loop_start[l];
            shape_quad(s, i, next, n + next, n + i);
        }
}

static inline void shape_box(shape *s, double x0, double y0, double z0, double x1, double y1, double z1) {
    const double xy[8] = {x0, y0, x1, y0, x1, y1, x0, y1};
    const int loops[2] = {0, 4};
    shape_prism(s, xy, loops, 1, z0, z1);
}

static inline void shape_tetrahedron(shape *s) {
    shape_begin(s);
    shape_vertex(s, 0, 0, 0), shape_vertex(s, 1, 0, 0), shape_vertex(s, 0, 1, 0), shape_vertex(s, 0, 0, 1);
    shape_triangle(s, 0, 2, 1), shape_triangle(s, 0, 1, 3), shape_triangle(s, 1, 2, 3), shape_triangle(s, 2, 0, 3);
}

/* The cube 0..2 without the corner (2,2,2), cut through the middles of its edges: 10 vertices, 7 faces. */
static inline void shape_cut_cube(shape *s) {
    const int bottom[4] = {0, 3, 2, 1}, front[4] = {0, 1, 5, 4}, left[4] = {0, 4, 6, 3};
    const int right[5] = {1, 2, 7, 9, 5}, back[5] = {2, 3, 6, 8, 7}, top[5] = {4, 5, 9, 8, 6}, cut[3] = {7, 8, 9};
    const int *faces[7];
    const int counts[7] = {4, 4, 4, 5, 5, 5, 3};
    int f;
    faces[0] = bottom, faces[1] = front, faces[2] = left, faces[3] = right, faces[4] = back, faces[5] = top;
    faces[6] = cut;
    shape_begin(s);
    shape_vertex(s, 0, 0, 0), shape_vertex(s, 2, 0, 0), shape_vertex(s, 2, 2, 0), shape_vertex(s, 0, 2, 0);
    shape_vertex(s, 0, 0, 2), shape_vertex(s, 2, 0, 2), shape_vertex(s, 0, 2, 2);
    shape_vertex(s, 2, 2, 1), shape_vertex(s, 1, 2, 2), shape_vertex(s, 2, 1, 2);
    for (f = 0; f < 7; f++) {
        shape_face(s);
        shape_loop(s, faces[f], counts[f]);
    }
}

/* All vertices on one plane normal.x = offset, sorted round the normal, as a face. */
static inline void shape_face_on_plane(shape *s, int nx, int ny, int nz, int offset) {
    const double n[3] = {(double)nx, (double)ny, (double)nz};
    double angle[16], u[3], w[3], c[3] = {0, 0, 0};
    int loop[16], count = 0, v, i, k;
    for (v = 0; v < s->vertex_count; v++) {
        const double p[3] = {(double)s->vertices[v].x, (double)s->vertices[v].y, (double)s->vertices[v].z};
        if (n[0] * p[0] + n[1] * p[1] + n[2] * p[2] != offset) continue;
        for (i = 0; i < 3; i++) c[i] += p[i];
        loop[count++] = v;
    }
    for (i = 0; i < 3; i++) c[i] /= count;
    u[0] = (double)s->vertices[loop[0]].x - c[0], u[1] = (double)s->vertices[loop[0]].y - c[1];
    u[2] = (double)s->vertices[loop[0]].z - c[2];
    for (i = 0; i < 3; i++) w[i] = n[(i + 1) % 3] * u[(i + 2) % 3] - n[(i + 2) % 3] * u[(i + 1) % 3];
    for (i = 0; i < 3; i++) w[i] /= sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    for (k = 0; k < count; k++) {
        const dgfem_vec3 p = s->vertices[loop[k]];
        const double d[3] = {(double)p.x - c[0], (double)p.y - c[1], (double)p.z - c[2]};
        angle[k] = atan2(d[0] * w[0] + d[1] * w[1] + d[2] * w[2], d[0] * u[0] + d[1] * u[1] + d[2] * u[2]);
    }
    for (k = 1; k < count; k++)
        for (i = k; i > 0 && angle[i] < angle[i - 1]; i--) {
            const double swap_angle = angle[i];
            const int swap = loop[i];
            angle[i] = angle[i - 1], angle[i - 1] = swap_angle;
            loop[i] = loop[i - 1], loop[i - 1] = swap;
        }
    shape_face(s);
    shape_loop(s, loop, count);
}

/* All permutations of (0, +-1, +-2): 24 vertices, 6 squares, 8 hexagons. */
static inline void shape_truncated_octahedron(shape *s) {
    int axis, other, a, b;
    shape_begin(s);
    for (axis = 0; axis < 3; axis++)
        for (other = 1; other < 3; other++)
            for (a = -1; a <= 1; a += 2)
                for (b = -1; b <= 1; b += 2) {
                    double p[3] = {0, 0, 0};
                    p[(axis + other) % 3] = a, p[(axis + 3 - other) % 3] = 2 * b;
                    shape_vertex(s, p[0], p[1], p[2]);
                }
    for (a = -1; a <= 1; a += 2)
        for (axis = 0; axis < 3; axis++)
            shape_face_on_plane(s, axis == 0 ? a : 0, axis == 1 ? a : 0, axis == 2 ? a : 0, 2);
    for (a = 0; a < 8; a++) shape_face_on_plane(s, a & 1 ? 1 : -1, a & 2 ? 1 : -1, a & 4 ? 1 : -1, 3);
}

/* A star of nine points on a fine lattice, as a prism: 36 vertices, 20 faces, not convex. */
static inline void shape_star_prism(shape *s) {
    double xy[36];
    const int loops[2] = {0, 18};
    int i;
    for (i = 0; i < 18; i++) {
        const double radius = i % 2 ? 3 : 7, angle = 2 * 3.14159265358979324 * i / 18;
        xy[2 * i] = floor(radius * cos(angle) * 16 + 0.5) / 16;
        xy[2 * i + 1] = floor(radius * sin(angle) * 16 + 0.5) / 16;
    }
    shape_prism(s, xy, loops, 1, -2, 2);
}

/* Triangles on a torus, vertices on a fine lattice: rings * sides vertices, twice as many faces. */
static inline void shape_torus(shape *s, int rings, int sides) {
    int i, k;
    shape_begin(s);
    for (i = 0; i < rings; i++)
        for (k = 0; k < sides; k++) {
            const double a = 2 * 3.14159265358979324 * i / rings, b = 2 * 3.14159265358979324 * k / sides;
            const double r = 5 + 2 * cos(b);
            shape_vertex(s, floor(r * cos(a) * 16 + 0.5) / 16, floor(r * sin(a) * 16 + 0.5) / 16,
                         floor(2 * sin(b) * 16 + 0.5) / 16);
        }
    for (i = 0; i < rings; i++)
        for (k = 0; k < sides; k++) {
            const int i1 = (i + 1) % rings, k1 = (k + 1) % sides;
            const int v = i * sides + k, right = i1 * sides + k, up = i * sides + k1, both = i1 * sides + k1;
            shape_triangle(s, v, right, both);
            shape_triangle(s, v, both, up);
        }
}

/* A plate 8 x 6 x 2 with two square holes through it; 24 vertices, 14 faces. */
static inline void shape_plate(shape *s) {
    const double xy[24] = {0, 0, 8, 0, 8, 6, 0, 6, 1, 2, 1, 4, 3, 4, 3, 2, 5, 1, 5, 5, 7, 5, 7, 1};
    const int loops[4] = {0, 4, 8, 12};
    shape_prism(s, xy, loops, 3, 0, 2);
}

/* An L of side 4 and arms of width 1, 2 high, its caps not convex. */
static inline void shape_bracket(shape *s) {
    const double xy[12] = {0, 0, 4, 0, 4, 1, 1, 1, 1, 4, 0, 4};
    const int loops[2] = {0, 6};
    shape_prism(s, xy, loops, 1, 0, 2);
}

/* The box 0..4 with the void 1..3 in it. */
static inline void shape_hollow_box(shape *s, shape *scratch) {
    shape_box(s, 0, 0, 0, 4, 4, 4);
    shape_box(scratch, 1, 1, 1, 3, 3, 3);
    shape_reverse(scratch);
    shape_append(s, scratch);
}

#endif
