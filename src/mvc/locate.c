#pragma once
#include "cut.c"
/* Where points are at rest: the element that contains one, or the nearest place of the boundary. */

/* ---- a grid of boxes, in which elements are found by place ---- */

enum { DGFEM_MVCI_MAX_GRID = 64 };

typedef struct dgfem_mvci_grid {
    dgfem_vec3 lower, cell;
    int size[3];
    int *start; /* [cells + 1] into items */
    int *items; /* elements whose boxes meet each cell */
} dgfem_mvci_grid;

static dgfem_real dgfem_mvci_component(dgfem_vec3 v, int axis) { return axis == 0 ? v.x : axis == 1 ? v.y : v.z; }

/* The cell of x along an axis; the outermost ones reach to infinity. */
static int dgfem_mvci_grid_at(const dgfem_mvci_grid *grid, dgfem_vec3 x, int axis) {
    dgfem_real at = (dgfem_mvci_component(x, axis) - dgfem_mvci_component(grid->lower, axis)) /
                    dgfem_mvci_component(grid->cell, axis);
    if (!(at > 0)) return 0;
    return at < (dgfem_real)grid->size[axis] ? (int)at : grid->size[axis] - 1;
}

static int dgfem_mvci_grid_cell(const dgfem_mvci_grid *grid, int i, int j, int k) {
    return i + grid->size[0] * (j + grid->size[1] * k);
}

/* A little larger than the element, so that no point on its surface falls out by round-off. */
static void dgfem_mvci_element_box(const dgfem_mvc *body, int e, dgfem_vec3 box[2]) {
    const int *nodes = body->system->nodes, *start = body->system->node_start + e;
    box[0] = box[1] = body->rest[nodes[start[0]]];
    for (int i = start[0]; i < start[1]; i++) dgfem_mvci_extend(&box[0], &box[1], body->rest[nodes[i]]);
    dgfem_real edge = DGFEM_R(1e-3) * dgfem_mvci_distance(box[0], box[1]);
    box[0] = dgfem_mvci_sub(box[0], dgfem_mvci_vec3(edge, edge, edge));
    box[1] = dgfem_mvci_add(box[1], dgfem_mvci_vec3(edge, edge, edge));
}

/* Counts the elements of each cell in start[cell + 1], or with `items` writes them and moves start[cell] to their
   end. */
static void dgfem_mvci_grid_enter(const dgfem_mvc *body, dgfem_mvci_grid *grid) {
    for (int e = 0; e < body->element_count; e++) {
        dgfem_vec3 box[2];
        int from[3], to[3];
        dgfem_mvci_element_box(body, e, box);
        for (int axis = 0; axis < 3; axis++) {
            from[axis] = dgfem_mvci_grid_at(grid, box[0], axis);
            to[axis] = dgfem_mvci_grid_at(grid, box[1], axis);
        }
        for (int k = from[2]; k <= to[2]; k++)
            for (int j = from[1]; j <= to[1]; j++)
                for (int i = from[0]; i <= to[0]; i++) {
                    int cell = dgfem_mvci_grid_cell(grid, i, j, k);
                    if (grid->items) grid->items[grid->start[cell]++] = e;
                    else grid->start[cell + 1]++;
                }
    }
}

static int dgfem_mvci_grid_create(const dgfem_mvc *body, dgfem_mvci_scratch *scratch, dgfem_mvci_grid *grid) {
    dgfem_vec3 lower = body->rest[0], upper = lower;
    int side = (int)cbrt((double)body->element_count) + 1, cells;
    for (int i = 0; i < body->node_count; i++) dgfem_mvci_extend(&lower, &upper, body->rest[i]);
    dgfem_vec3 extent = dgfem_mvci_sub(upper, lower);
    if (side > DGFEM_MVCI_MAX_GRID) side = DGFEM_MVCI_MAX_GRID;
    memset(grid, 0, sizeof *grid);
    grid->lower = lower;
    grid->cell = dgfem_mvci_scale(1 / (dgfem_real)side, extent);
    for (int axis = 0; axis < 3; axis++) grid->size[axis] = side;
    cells = side * side * side;
    grid->start = (int *)dgfem_mvci_take(scratch, (size_t)cells + 1, sizeof(int));
    if (!grid->start) return 0;
    dgfem_mvci_grid_enter(body, grid);
    for (int c = 0; c < cells; c++) grid->start[c + 1] += grid->start[c];
    grid->items = (int *)dgfem_mvci_take(scratch, (size_t)grid->start[cells], sizeof(int));
    if (!grid->items) return 0;
    dgfem_mvci_grid_enter(body, grid);
    for (int c = cells; c > 0; c--) grid->start[c] = grid->start[c - 1];
    grid->start[0] = 0;
    return 1;
}

/* ---- places ---- */

/* Whether x is in the tetrahedron of a triangle and c, up to round-off. */
static int dgfem_mvci_in_tetrahedron(const dgfem_vec3 corners[4], dgfem_vec3 x) {
    static const int faces[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
    dgfem_vec3 d[4];
    dgfem_real part[4], whole = 0;
    for (int i = 0; i < 4; i++) d[i] = dgfem_mvci_sub(corners[i], x);
    for (int i = 0; i < 4; i++) {
        const int *f = faces[i];
        part[i] = dgfem_mvci_dot(d[f[0]], dgfem_mvci_cross(d[f[1]], d[f[2]]));
        whole += part[i];
    }
    for (int i = 0; i < 4; i++)
        if (!(part[i] / whole >= -64 * DGFEM_MVC_EPSILON)) return 0;
    return 1;
}

/* Whether x, at rest, is in an element: in one of the tetrahedra that its triangles and its centroid span. */
static int dgfem_mvci_element_contains(const dgfem_mvc *body, int e, dgfem_vec3 x) {
    int face_count, nodes[3];
    const int *faces = dgfem_mvci_element_faces(body->mesh, e, &face_count);
    dgfem_vec3 corners[4];
    corners[3] = body->centre[e];
    for (int k = 0; k < face_count; k++)
        for (int t = 0; t < body->mesh->faces[faces[k] / 2].triangle_count; t++) {
            dgfem_mvci_triangle(body->mesh, faces[k] / 2, faces[k] & 1, t, nodes);
            for (int i = 0; i < 3; i++) corners[i] = body->rest[nodes[i]];
            if (dgfem_mvci_in_tetrahedron(corners, x)) return 1;
        }
    return 0;
}

/* The lowest element that contains x, or DGFEM_NONE. */
static int dgfem_mvci_locate(const dgfem_mvc *body, const dgfem_mvci_grid *grid, dgfem_vec3 x) {
    int cell = dgfem_mvci_grid_cell(grid, dgfem_mvci_grid_at(grid, x, 0), dgfem_mvci_grid_at(grid, x, 1),
                                    dgfem_mvci_grid_at(grid, x, 2));
    for (int i = grid->start[cell]; i < grid->start[cell + 1]; i++) {
        dgfem_vec3 box[2];
        int e = grid->items[i];
        dgfem_mvci_element_box(body, e, box);
        if (x.x >= box[0].x && x.y >= box[0].y && x.z >= box[0].z && x.x <= box[1].x && x.y <= box[1].y &&
            x.z <= box[1].z && dgfem_mvci_element_contains(body, e, x))
            return e;
    }
    return DGFEM_NONE;
}

/* The point of a triangle that is the nearest to x, by the region of its plane that x projects to (Ericson 2005,
   5.1.5). */
static dgfem_vec3 dgfem_mvci_nearest_in_triangle(const dgfem_vec3 *p, dgfem_vec3 x) {
    dgfem_vec3 ab = dgfem_mvci_sub(p[1], p[0]), ac = dgfem_mvci_sub(p[2], p[0]), bc = dgfem_mvci_sub(p[2], p[1]);
    dgfem_vec3 ax = dgfem_mvci_sub(x, p[0]), bx = dgfem_mvci_sub(x, p[1]), cx = dgfem_mvci_sub(x, p[2]);
    dgfem_real d1 = dgfem_mvci_dot(ab, ax), d2 = dgfem_mvci_dot(ac, ax), d3 = dgfem_mvci_dot(ab, bx);
    dgfem_real d4 = dgfem_mvci_dot(ac, bx), d5 = dgfem_mvci_dot(ab, cx), d6 = dgfem_mvci_dot(ac, cx);
    dgfem_real va = d3 * d6 - d5 * d4, vb = d5 * d2 - d1 * d6, vc = d1 * d4 - d3 * d2;
    if (d1 <= 0 && d2 <= 0) return p[0];
    if (d3 >= 0 && d4 <= d3) return p[1];
    if (d6 >= 0 && d5 <= d6) return p[2];
    if (vc <= 0 && d1 >= 0 && d3 <= 0) return dgfem_mvci_axpy(p[0], d1 / (d1 - d3), ab);
    if (vb <= 0 && d2 >= 0 && d6 <= 0) return dgfem_mvci_axpy(p[0], d2 / (d2 - d6), ac);
    if (va <= 0 && d4 >= d3 && d5 >= d6) return dgfem_mvci_axpy(p[1], (d4 - d3) / ((d4 - d3) + (d5 - d6)), bc);
    return dgfem_mvci_axpy(dgfem_mvci_axpy(p[0], vb / (va + vb + vc), ab), vc / (va + vb + vc), ac);
}

/* The point of the boundary that is the nearest to x, and its element. */
static dgfem_vec3 dgfem_mvci_nearest_on_boundary(const dgfem_mvc *body, dgfem_vec3 x, int *element) {
    dgfem_vec3 best = x;
    dgfem_real least = 0;
    *element = DGFEM_NONE;
    for (int f = 0; f < body->face_count; f++) {
        int count;
        const int *at = dgfem_mvci_face_triangles(body->mesh, f, &count);
        for (int t = 0; body->mesh->faces[f].owner[1] == DGFEM_NONE && t < count; t++, at += 3) {
            dgfem_vec3 p[3];
            for (int i = 0; i < 3; i++) p[i] = body->rest[at[i]];
            p[0] = dgfem_mvci_nearest_in_triangle(p, x);
            dgfem_real distance = dgfem_mvci_distance(p[0], x);
            if (*element != DGFEM_NONE && !(distance < least)) continue;
            *element = body->mesh->faces[f].owner[0], least = distance, best = p[0];
        }
    }
    return best;
}
