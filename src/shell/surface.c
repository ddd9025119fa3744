#pragma once
#include "split.c"
/* Render surface: the curved elements evaluated on a lattice of parameters, with their exact normals, as one or two
   sheets of triangles, closed by rims along the boundary.

   Points on sides are shared by the elements that meet there, corners by all around them. The lattice of a
   quadrilateral has (m + 1)^2 points, row by row; row j of a triangle's has m + 1 - j. */

DGFEM_API dgfem_shell_surface_desc dgfem_default_shell_surface_desc(void) {
    dgfem_shell_surface_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_SHELL_COOKIE;
    desc.subdivision = 2;
    desc.sides = 2;
    return desc;
}

static int dgfem_shelli_row_length(int nodes, int m, int j) { return nodes == 8 ? m + 1 : m + 1 - j; }

/* First point of row j. */
static int dgfem_shelli_row_start(int nodes, int m, int j) {
    return nodes == 8 ? (m + 1) * j : (m + 1) * j - j * (j - 1) / 2;
}
static int dgfem_shelli_lattice_size(int nodes, int m) {
    return dgfem_shelli_row_start(nodes, m, m) + dgfem_shelli_row_length(nodes, m, m);
}

static dgfem_shelli_parameter dgfem_shelli_lattice_at(int nodes, int m, int i, int j) {
    dgfem_real a = (dgfem_real)i / (dgfem_real)m, b = (dgfem_real)j / (dgfem_real)m;
    return nodes == 8 ? dgfem_shelli_parameter_make(2 * a - 1, 2 * b - 1) : dgfem_shelli_parameter_make(a, b);
}

/* Where step k = 0 .. m of a side, in the element's own direction, stands in its lattice. */
static int dgfem_shelli_lattice_side(int nodes, int m, int side, int k) {
    int i = side == 0 ? k : side == 1 ? m : m - k, j = side == 0 ? 0 : side == 1 ? k : m;
    if (nodes == 8 && side == 3) i = 0, j = m - k;
    if (nodes == 6 && side == 1) i = m - k, j = k;
    if (nodes == 6 && side == 2) i = 0, j = m - k;
    return dgfem_shelli_row_start(nodes, m, j) + i;
}

/* ---- creation ---- */

/* Numbers all points: corners by node, then the inner points of sides by edge, then the rest. */
static int dgfem_shelli_number_points(dgfem_shell_surface *surface, const dgfem_shell *shell, int *corner) {
    int m = surface->subdivision, next = 0;
    for (int i = 0; i < shell->node_count; i++) corner[i] = DGFEM_NONE;
    for (int e = 0; e < shell->element_count; e++)
        for (int k = 0; k < dgfem_shelli_corners(&shell->elements[e]); k++)
            if (corner[shell->elements[e].node[k]] == DGFEM_NONE) corner[shell->elements[e].node[k]] = next++;
    int first = next;
    next += shell->edge_count * (m - 1);
    for (int e = 0; e < shell->element_count; e++) {
        const dgfem_shell_element *element = &shell->elements[e];
        int n = element->node_count, *point = surface->point_of + surface->point_start[e];
        for (int i = 0; i < dgfem_shelli_lattice_size(n, m); i++) point[i] = DGFEM_NONE;
        for (int side = 0; side < n / 2; side++) {
            const dgfem_shell_edge *edge = &shell->edges[element->edge[side]];
            int forward = edge->element[0] == e && edge->side[0] == side;
            point[dgfem_shelli_lattice_side(n, m, side, 0)] = corner[element->node[side]];
            for (int k = 1; k < m; k++)
                point[dgfem_shelli_lattice_side(n, m, side, k)] =
                    first + element->edge[side] * (m - 1) + (forward ? k : m - k) - 1;
        }
        for (int i = 0; i < dgfem_shelli_lattice_size(n, m); i++)
            if (point[i] == DGFEM_NONE) point[i] = next++;
    }
    return next;
}

static void dgfem_shelli_add_face(dgfem_shell_surface *surface, int e, int a, int b, int c) {
    int sheets = surface->sides, offset = surface->point_count;
    for (int sheet = 0; sheet < sheets; sheet++) {
        int *t = surface->triangles + 3 * surface->triangle_count;
        t[0] = a + sheet * offset, t[1] = (sheet ? c : b) + sheet * offset, t[2] = (sheet ? b : c) + sheet * offset;
        surface->triangle_element[surface->triangle_count++] = e;
    }
}

static void dgfem_shelli_add_faces(dgfem_shell_surface *surface, const dgfem_shell *shell) {
    int m = surface->subdivision;
    for (int e = 0; e < shell->element_count; e++) {
        int n = shell->elements[e].node_count;
        const int *point = surface->point_of + surface->point_start[e];
        for (int j = 0; j < m; j++) {
            const int *row = point + dgfem_shelli_row_start(n, m, j),
                      *next = point + dgfem_shelli_row_start(n, m, j + 1);
            int length = dgfem_shelli_row_length(n, m, j);
            for (int i = 0; i + 1 < length; i++) {
                if (n == 8) {
                    dgfem_shelli_add_face(surface, e, row[i], row[i + 1], next[i + 1]);
                    dgfem_shelli_add_face(surface, e, row[i], next[i + 1], next[i]);
                } else {
                    dgfem_shelli_add_face(surface, e, row[i], row[i + 1], next[i]);
                    if (i + 2 < length) dgfem_shelli_add_face(surface, e, row[i + 1], next[i + 1], next[i]);
                }
            }
        }
    }
}

/* A strip from the upper to the lower sheet along every boundary edge. */
static void dgfem_shelli_add_rims(dgfem_shell_surface *surface, const dgfem_shell *shell) {
    int m = surface->subdivision, offset = surface->point_count;
    for (int i = 0; surface->sides == 2 && i < shell->edge_count; i++) {
        const dgfem_shell_edge *edge = &shell->edges[i];
        int e = edge->element[0], n = shell->elements[e].node_count;
        const int *point = surface->point_of + surface->point_start[e];
        if (!dgfem_shelli_is_boundary(edge)) continue;
        for (int k = 0; k < m; k++) {
            int a = point[dgfem_shelli_lattice_side(n, m, edge->side[0], k)];
            int b = point[dgfem_shelli_lattice_side(n, m, edge->side[0], k + 1)];
            int *t = surface->triangles + 3 * surface->triangle_count;
            t[0] = a, t[1] = a + offset, t[2] = b + offset;
            t[3] = a, t[4] = b + offset, t[5] = b;
            surface->triangle_element[surface->triangle_count++] = e;
            surface->triangle_element[surface->triangle_count++] = e;
        }
    }
}

/* Whether the numbers of triangles' corners and of lattice points, on all sheets, are ints. */
static int dgfem_shelli_surface_fits(const dgfem_shell *shell, const dgfem_shell_surface_desc *desc) {
    const size_t sheets = (size_t)desc->sides, m = (size_t)desc->subdivision, limit = INT_MAX;
    size_t points = 0, corners = 0;
    for (int e = 0; e < shell->element_count; e++) {
        int nodes = shell->elements[e].node_count;
        points += sheets * (size_t)dgfem_shelli_lattice_size(nodes, desc->subdivision);
        corners += 3 * sheets * m * m * (nodes == 8 ? 2 : 1) + 6 * m * (size_t)nodes / 2;
        if (points > limit || corners > limit) return 0;
    }
    return 1;
}

static int dgfem_shelli_surface_build(dgfem_shell_surface *surface, const dgfem_shell *shell) {
    const dgfem_hooks *hooks = &surface->hooks;
    dgfem_shelli_scratch scratch = dgfem_shelli_scratch_make(hooks);
    size_t m = (size_t)surface->subdivision, triangles = 0;
    int *corner = (int *)dgfem_shelli_take(&scratch, (size_t)shell->node_count, sizeof(int)), points = 0;
    surface->point_start = (int *)dgfem_shelli_allocate(hooks, (size_t)shell->element_count + 1, sizeof(int));
    for (int e = 0; surface->point_start && e < shell->element_count; e++) {
        surface->point_start[e] = points;
        points += dgfem_shelli_lattice_size(shell->elements[e].node_count, (int)m);
        triangles += m * m * (shell->elements[e].node_count == 8 ? 2 : 1) * (size_t)surface->sides;
    }
    for (int i = 0; i < shell->edge_count; i++) triangles += dgfem_shelli_is_boundary(&shell->edges[i]) ? 2 * m : 0;
    surface->point_of = (int *)dgfem_shelli_allocate(hooks, (size_t)points, sizeof(int));
    surface->triangles = (int *)dgfem_shelli_allocate(hooks, 3 * triangles, sizeof(int));
    surface->triangle_element = (int *)dgfem_shelli_allocate(hooks, triangles, sizeof(int));
    int made = corner && surface->point_start && surface->point_of && surface->triangles && surface->triangle_element;
    if (made) {
        surface->point_start[shell->element_count] = points;
        surface->point_count = dgfem_shelli_number_points(surface, shell, corner);
        surface->vertex_count = surface->point_count * surface->sides;
        dgfem_shelli_add_faces(surface, shell);
        dgfem_shelli_add_rims(surface, shell);
        size_t vertices = (size_t)surface->vertex_count;
        surface->positions = (dgfem_vec3 *)dgfem_shelli_allocate(hooks, vertices, sizeof(dgfem_vec3));
        surface->normals = (dgfem_vec3 *)dgfem_shelli_allocate(hooks, vertices, sizeof(dgfem_vec3));
        surface->half = (dgfem_real *)dgfem_shelli_allocate(hooks, (size_t)surface->point_count, sizeof(dgfem_real));
        made = surface->positions && surface->normals && surface->half;
    }
    for (int e = 0; made && e < shell->element_count; e++)
        for (int i = surface->point_start[e]; i < surface->point_start[e + 1]; i++) {
            dgfem_real *half = &surface->half[surface->point_of[i]];
            *half = dgfem_shelli_max(*half, shell->elements[e].thickness / 2);
        }
    dgfem_shelli_scratch_free(&scratch);
    return made;
}

DGFEM_API dgfem_status dgfem_shell_surface_create(const dgfem_shell *shell, const dgfem_shell_surface_desc *desc,
                                                  dgfem_shell_surface **out) {
    if (!out) return DGFEM_ERROR_ARGUMENT;
    *out = NULL;
    if (!desc || desc->cookie != DGFEM_SHELL_COOKIE) return DGFEM_ERROR_DESCRIPTOR;
    if (!shell) return dgfem_shelli_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "surface: no shell");
    if (desc->subdivision < 1 || desc->subdivision > 64 || desc->sides < 1 || desc->sides > 2)
        return dgfem_shelli_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "surface: subdivision %d, sides %d",
                                 desc->subdivision, desc->sides);
    if (!dgfem_shelli_surface_fits(shell, desc))
        return dgfem_shelli_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT,
                                 "surface: %d elements with subdivision %d give more triangles than an int can count",
                                 shell->element_count, desc->subdivision);
    dgfem_shell_surface *surface = (dgfem_shell_surface *)dgfem_shelli_allocate(&desc->hooks, 1, sizeof *surface);
    if (!surface) return dgfem_shelli_fail_memory(&desc->hooks);
    surface->hooks = desc->hooks;
    surface->subdivision = desc->subdivision;
    surface->sides = desc->sides;
    surface->revision = shell->revision;
    surface->element_count = shell->element_count;
    surface->node_count = shell->node_count;
    if (!dgfem_shelli_surface_build(surface, shell)) {
        dgfem_shell_surface_destroy(surface);
        return dgfem_shelli_fail_memory(&desc->hooks);
    }
    *out = surface;
    return dgfem_shell_surface_update(surface, shell);
}

DGFEM_API void dgfem_shell_surface_destroy(dgfem_shell_surface *surface) {
    if (!surface) return;
    dgfem_hooks hooks = surface->hooks;
    dgfem_shelli_free(&hooks, surface->positions);
    dgfem_shelli_free(&hooks, surface->normals);
    dgfem_shelli_free(&hooks, surface->triangles);
    dgfem_shelli_free(&hooks, surface->triangle_element);
    dgfem_shelli_free(&hooks, surface->point_of);
    dgfem_shelli_free(&hooks, surface->point_start);
    dgfem_shelli_free(&hooks, surface->half);
    dgfem_shelli_free(&hooks, surface);
}

/* ---- update ---- */

/* Positions and summed normals of one lattice point in all elements of a kind. */
static void dgfem_shelli_surface_point(dgfem_shell_surface *surface, const dgfem_shell *shell, int nodes, int index,
                                       dgfem_shelli_parameter p) {
    dgfem_shelli_basis f;
    dgfem_shelli_basis_at(nodes, p, &f);
    for (int e = 0; e < shell->element_count; e++) {
        const dgfem_shell_element *element = &shell->elements[e];
        dgfem_vec3 x[DGFEM_SHELL_MAX_NODES];
        if (element->node_count != nodes) continue;
        int point = surface->point_of[surface->point_start[e] + index];
        dgfem_shelli_gather(shell->position, element->node, nodes, x);
        surface->positions[point] = dgfem_shelli_sum(f.n, x, nodes);
        dgfem_vec3 normal = dgfem_shelli_cross(dgfem_shelli_sum(f.d1, x, nodes), dgfem_shelli_sum(f.d2, x, nodes));
        surface->normals[point] = dgfem_shelli_add(surface->normals[point], dgfem_shelli_unit(normal));
    }
}

DGFEM_API dgfem_status dgfem_shell_surface_update(dgfem_shell_surface *surface, const dgfem_shell *shell) {
    if (!surface || !shell) return DGFEM_ERROR_ARGUMENT;
    if (surface->revision != shell->revision)
        return dgfem_shelli_fail(&surface->hooks, DGFEM_ERROR_REVISION, "surface of revision %d, shell has %d",
                                 surface->revision, shell->revision);
    if (surface->element_count != shell->element_count || surface->node_count != shell->node_count)
        return dgfem_shelli_fail(&surface->hooks, DGFEM_ERROR_REVISION,
                                 "surface of %d elements and %d nodes, shell has %d and %d", surface->element_count,
                                 surface->node_count, shell->element_count, shell->node_count);
    int m = surface->subdivision, count = surface->point_count;
    memset(surface->normals, 0, (size_t)count * sizeof *surface->normals);
    for (int nodes = 6; nodes <= 8; nodes += 2)
        for (int j = 0; j <= m; j++)
            for (int i = 0; i < dgfem_shelli_row_length(nodes, m, j); i++)
                dgfem_shelli_surface_point(surface, shell, nodes, dgfem_shelli_row_start(nodes, m, j) + i,
                                           dgfem_shelli_lattice_at(nodes, m, i, j));
    for (int i = 0; i < count; i++) {
        dgfem_vec3 x = surface->positions[i], normal = dgfem_shelli_unit(surface->normals[i]);
        surface->normals[i] = normal;
        if (surface->sides == 1) continue;
        surface->positions[i] = dgfem_shelli_axpy(x, surface->half[i], normal);
        surface->positions[count + i] = dgfem_shelli_axpy(x, -surface->half[i], normal);
        surface->normals[count + i] = dgfem_shelli_scale(-1, normal);
    }
    return DGFEM_OK;
}
