#pragma once
#include "mesh_build.c"
#include "mesh_merge.c"
#include "split.c"
/* Closed triangle surface x hexahedral grid -> mesh.

   The surface becomes one element with a face per triangle. The grid's planes split it, one axis after the other, so
   that both neighbours of a new face share it from the start. At the end each cell's part is taken apart into its
   components, and these are the elements. */

DGFEM_API dgfem_slice_desc dgfem_default_slice_desc(void) {
    dgfem_slice_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_COOKIE;
    desc.cells = 10;
    desc.grid_cell = dgfemi_vec3(1, 1, 1);
    desc.grid_cells[0] = desc.grid_cells[1] = desc.grid_cells[2] = 1;
    desc.sliver = DGFEM_R(1e-3);
    return desc;
}

typedef struct dgfemi_slicer {
    const dgfem_slice_desc *desc;
    const dgfem_hooks *hooks;
    dgfem_mesh *mesh;        /* holds the surface's vertices from the start */
    dgfemi_arena arena;
    int *triangles;          /* [3 * count] half-edge h runs from triangles[h] to triangles[dgfemi_half_edge_next(h)] */
    dgfem_vec3 *normals;     /* [count] unit */
    int *twin;               /* [3 * count] the opposite half-edge of the same solid corner */
    int *chain;              /* [3 * count] previous half-edge on the same edge, or DGFEM_NONE */
    int *middle;             /* [3 * count] vertex inserted into the half-edge, or DGFEM_NONE */
    int *shell;              /* [count] union-find over triangles that share edges; a root is its shell's first triangle */
    int count;               /* of triangles */
    dgfem_vec3 lower, upper; /* box of the vertices in use */
    double volume, area;
    dgfemi_lattice lattice;
    dgfemi_splitter splitter;
    dgfem_real *low, *high;  /* [element_count] extent along the axis at work */
    int low_capacity, high_capacity;
} dgfemi_slicer;

static int dgfemi_half_edge_next(int h) { return h % 3 == 2 ? h - 2 : h + 1; }

/* ---- the input ---- */

static dgfem_status dgfemi_slice_check_grid(const dgfem_slice_desc *desc) {
    const dgfem_hooks *hooks = &desc->hooks;
    double cells = 1;
    int axis;
    if (!desc->use_grid) {
        if (desc->cells < 1) return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "slice: %d cells", desc->cells);
        return DGFEM_OK;
    }
    if (!dgfemi_is_finite3(desc->grid_lower) || !dgfemi_is_finite3(desc->grid_cell))
        return dgfemi_fail(hooks, DGFEM_ERROR_NOT_FINITE, "slice: grid_lower or grid_cell");
    for (axis = 0; axis < 3; axis++) {
        if (!(dgfemi_axis(desc->grid_cell, axis) > 0))
            return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "slice: grid_cell is %g along axis %d",
                               (double)dgfemi_axis(desc->grid_cell, axis), axis);
        if (desc->grid_cells[axis] < 1)
            return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "slice: %d grid_cells along axis %d",
                               desc->grid_cells[axis], axis);
        cells *= desc->grid_cells[axis];
    }
    if (cells > INT_MAX) return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "slice: a grid of %g cells", cells);
    return DGFEM_OK;
}

static dgfem_status dgfemi_slice_check_desc(const dgfem_slice_desc *desc) {
    const dgfem_hooks *hooks = &desc->hooks;
    const dgfem_points_in *points = &desc->vertices;
    dgfem_status status = dgfemi_check_points(hooks, points->data, points->type, points->stride, points->count,
                                              "slice: vertices");
    if (status) return status;
    if (desc->triangle_count < 0 || desc->triangle_count > INT_MAX / 3 || (desc->triangle_count > 0 && !desc->triangles))
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "slice: no data for %d triangles", desc->triangle_count);
    if (!(desc->sliver >= 0) || !(desc->sliver < 1))
        return dgfemi_fail(hooks, DGFEM_ERROR_ARGUMENT, "slice: sliver %g is not in [0, 1)", (double)desc->sliver);
    status = dgfemi_slice_check_grid(desc);
    if (status) return status;
    if (desc->triangle_count == 0) return dgfemi_fail(hooks, DGFEM_ERROR_EMPTY, "slice: the surface has no triangles");
    return DGFEM_OK;
}

static dgfem_status dgfemi_slice_read_vertices(dgfemi_slicer *slicer) {
    const dgfem_points_in *points = &slicer->desc->vertices;
    dgfem_mesh *mesh = slicer->mesh;
    int v;
    if (!dgfemi_mesh_reserve(mesh, points->count, 0, 0, 0, 0, 0)) return dgfemi_fail_memory(slicer->hooks);
    for (v = 0; v < points->count; v++) {
        mesh->vertices[v] = dgfemi_point_read(points, v);
        if (!dgfemi_is_finite3(mesh->vertices[v]))
            return dgfemi_fail(slicer->hooks, DGFEM_ERROR_NOT_FINITE, "vertex %d", v);
    }
    mesh->vertex_count = points->count;
    return DGFEM_OK;
}

/* Copies the triangles and finds their box. */
static dgfem_status dgfemi_slice_read_triangles(dgfemi_slicer *slicer) {
    const dgfem_mesh *mesh = slicer->mesh;
    const size_t count = (size_t)slicer->count;
    int t, i;
    slicer->triangles = (int *)dgfemi_arena_allocate(&slicer->arena, 3 * count, sizeof(int));
    slicer->twin = (int *)dgfemi_arena_allocate(&slicer->arena, 3 * count, sizeof(int));
    slicer->chain = (int *)dgfemi_arena_allocate(&slicer->arena, 3 * count, sizeof(int));
    slicer->middle = (int *)dgfemi_arena_allocate(&slicer->arena, 3 * count, sizeof(int));
    slicer->shell = (int *)dgfemi_arena_allocate(&slicer->arena, count, sizeof(int));
    slicer->normals = (dgfem_vec3 *)dgfemi_arena_allocate(&slicer->arena, count, sizeof(dgfem_vec3));
    if (!slicer->triangles || !slicer->twin || !slicer->chain || !slicer->middle || !slicer->shell ||
        !slicer->normals)
        return dgfemi_fail_memory(slicer->hooks);
    for (t = 0; t < slicer->count; t++) {
        const int *v = slicer->desc->triangles + 3 * t;
        for (i = 0; i < 3; i++) {
            if (v[i] < 0 || v[i] >= mesh->vertex_count)
                return dgfemi_fail(slicer->hooks, DGFEM_ERROR_INDEX, "triangle %d refers to vertex %d of %d", t, v[i],
                                   mesh->vertex_count);
            if (v[i] == v[(i + 1) % 3])
                return dgfemi_fail(slicer->hooks, DGFEM_ERROR_DEGENERATE, "triangle %d has vertex %d twice", t, v[i]);
            slicer->triangles[3 * t + i] = v[i];
            if (t == 0 && i == 0) slicer->lower = slicer->upper = mesh->vertices[v[i]];
            slicer->lower = dgfemi_min3(slicer->lower, mesh->vertices[v[i]]);
            slicer->upper = dgfemi_max3(slicer->upper, mesh->vertices[v[i]]);
        }
    }
    return DGFEM_OK;
}

/* ---- the grid ---- */

/* Cubic cells of edge 1.0001 * longest extent / cells, centred on the box. */
static dgfem_status dgfemi_slice_default_grid(dgfemi_slicer *slicer) {
    dgfemi_lattice *lattice = &slicer->lattice;
    dgfem_vec3 extent = dgfemi_sub(slicer->upper, slicer->lower);
    dgfem_real longest = dgfemi_max(extent.x, dgfemi_max(extent.y, extent.z));
    dgfem_real edge = DGFEM_R(1.0001) * longest / (dgfem_real)slicer->desc->cells;
    double cells = 1;
    int axis;
    if (!dgfemi_is_finite3(extent))
        return dgfemi_fail(slicer->hooks, DGFEM_ERROR_NOT_FINITE, "the surface's bounding box overflows");
    if (!(edge > 0)) return dgfemi_fail(slicer->hooks, DGFEM_ERROR_DEGENERATE, "the surface has no extent");
    for (axis = 0; axis < 3; axis++) {
        dgfem_real length = dgfemi_axis(extent, axis);
        int count = (int)ceil((double)(length / edge));
        count = count < 1 ? 1 : count;
        lattice->cell[axis] = edge;
        lattice->cells[axis] = count;
        lattice->lower[axis] = dgfemi_axis(slicer->lower, axis) + (length - (dgfem_real)count * edge) / 2;
        cells *= count;
    }
    if (cells > INT_MAX) return dgfemi_fail(slicer->hooks, DGFEM_ERROR_ARGUMENT, "slice: a grid of %g cells", cells);
    return DGFEM_OK;
}

static dgfem_status dgfemi_slice_given_grid(dgfemi_slicer *slicer) {
    dgfemi_lattice *lattice = &slicer->lattice;
    int axis;
    for (axis = 0; axis < 3; axis++) {
        dgfem_real upper;
        lattice->lower[axis] = dgfemi_axis(slicer->desc->grid_lower, axis);
        lattice->cell[axis] = dgfemi_axis(slicer->desc->grid_cell, axis);
        lattice->cells[axis] = slicer->desc->grid_cells[axis];
        upper = dgfemi_lattice_plane(lattice, axis, lattice->cells[axis]);
        if (lattice->lower[axis] > dgfemi_axis(slicer->upper, axis) || upper < dgfemi_axis(slicer->lower, axis))
            return dgfemi_fail(slicer->hooks, DGFEM_ERROR_EMPTY,
                               "the grid, %g to %g along axis %d, does not touch the surface, %g to %g",
                               (double)lattice->lower[axis], (double)upper, axis,
                               (double)dgfemi_axis(slicer->lower, axis), (double)dgfemi_axis(slicer->upper, axis));
    }
    return DGFEM_OK;
}

/* Sets the grid and moves vertices that only round-off keeps off its planes onto them. */
static dgfem_status dgfemi_slice_set_grid(dgfemi_slicer *slicer) {
    dgfem_mesh *mesh = slicer->mesh;
    dgfem_vec3 lower = slicer->lower, upper = slicer->upper;
    dgfem_real x = dgfemi_max(dgfemi_abs(lower.x), dgfemi_abs(upper.x));
    dgfem_real y = dgfemi_max(dgfemi_abs(lower.y), dgfemi_abs(upper.y));
    dgfem_real z = dgfemi_max(dgfemi_abs(lower.z), dgfemi_abs(upper.z));
    dgfem_status status = slicer->desc->use_grid ? dgfemi_slice_given_grid(slicer) : dgfemi_slice_default_grid(slicer);
    int v;
    slicer->lattice.noise = 8 * DGFEM_EPSILON * dgfemi_max(x, dgfemi_max(y, z));
    for (v = 0; !status && v < mesh->vertex_count; v++) dgfemi_lattice_snap(&slicer->lattice, &mesh->vertices[v]);
    return status;
}

/* ---- the surface ---- */

/* Normals and total area. */
static dgfem_status dgfemi_slice_measure_triangles(dgfemi_slicer *slicer) {
    const dgfem_vec3 *vertices = slicer->mesh->vertices;
    int t;
    for (t = 0; t < slicer->count; t++) {
        const int *v = slicer->triangles + 3 * t;
        dgfem_vec3 ab = dgfemi_sub(vertices[v[1]], vertices[v[0]]), bc = dgfemi_sub(vertices[v[2]], vertices[v[1]]);
        dgfem_vec3 normal = dgfemi_cross(ab, bc);
        dgfem_real twice = dgfemi_norm(normal);
        if (!(twice > 4 * DGFEM_EPSILON * dgfemi_norm(ab) * dgfemi_norm(bc)))
            return dgfemi_fail(slicer->hooks, DGFEM_ERROR_DEGENERATE, "triangle %d (vertices %d %d %d) has no area", t,
                               v[0], v[1], v[2]);
        slicer->normals[t] = dgfemi_normalized(normal);
        slicer->area += 0.5 * (double)twice;
    }
    return DGFEM_OK;
}

/* How many more half-edges run from the lower to the higher vertex than back. */
static int dgfemi_slice_balance(const dgfemi_slicer *slicer, int h) {
    int balance = 0;
    for (; h != DGFEM_NONE; h = slicer->chain[h])
        balance += slicer->triangles[h] < slicer->triangles[dgfemi_half_edge_next(h)] ? 1 : -1;
    return balance;
}

/* Chains the half-edges on each edge, in slicer->splitter.crossings; refuses edges where these do not cancel, naming
   the one that the first triangle has. */
static dgfem_status dgfemi_slice_chain_edges(dgfemi_slicer *slicer) {
    dgfemi_edge_map *map = &slicer->splitter.crossings;
    int h, open = DGFEM_NONE;
    size_t i;
    if (!dgfemi_edge_map_begin(slicer->hooks, map, 3 * (size_t)slicer->count / 2)) return dgfemi_fail_memory(slicer->hooks);
    for (h = 0; h < 3 * slicer->count; h++) {
        int a = slicer->triangles[h], b = slicer->triangles[dgfemi_half_edge_next(h)];
        dgfemi_edge_slot *slot = dgfemi_edge_map_at(map, a, b);
        slicer->chain[h] = DGFEM_NONE;
        if (dgfemi_edge_map_has(map, slot)) {
            slicer->chain[h] = slot->value;
            slot->value = h;
        } else if (!dgfemi_edge_map_set(slicer->hooks, map, slot, a, b, h)) {
            return dgfemi_fail_memory(slicer->hooks);
        }
    }
    for (i = 0; i < map->size; i++) {
        if (!dgfemi_edge_map_has(map, &map->slots[i]) || dgfemi_slice_balance(slicer, map->slots[i].value) == 0) continue;
        for (h = map->slots[i].value; slicer->chain[h] != DGFEM_NONE; h = slicer->chain[h]) {}
        if (open == DGFEM_NONE || h < open) open = h;
    }
    if (open != DGFEM_NONE)
        return dgfemi_fail(slicer->hooks, DGFEM_ERROR_OPEN, "edge between vertices %d and %d, of triangle %d",
                           slicer->triangles[open], slicer->triangles[dgfemi_half_edge_next(open)], open / 3);
    return DGFEM_OK;
}

/* ---- edges with more than two triangles ---- */

/* A triangle at an edge that runs towards the viewer, lower vertex first, and where it is around the edge. A triangle
   that has the edge in that sense (closing) has its solid on the clockwise side:

            \ closing               solid corners, each from an opening triangle counter-clockwise
       solid \                      to the next closing one
              o------ opening                                                                          */
typedef struct dgfemi_spoke {
    dgfem_real angle; /* grows from 0 to 4 */
    int half_edge, closing;
} dgfemi_spoke;

static int dgfemi_spoke_compare(const void *a, const void *b) {
    const dgfemi_spoke *x = (const dgfemi_spoke *)a, *y = (const dgfemi_spoke *)b;
    if (x->angle < y->angle) return -1;
    if (x->angle > y->angle) return 1;
    if (x->closing != y->closing) return y->closing - x->closing; /* solids that touch, not a solid without thickness */
    return (x->half_edge > y->half_edge) - (x->half_edge < y->half_edge);
}

/* Sorts the triangles at an edge by angle. */
static void dgfemi_slice_sort_spokes(const dgfemi_slicer *slicer, int last, dgfemi_spoke *spokes, int count) {
    const dgfem_vec3 *vertices = slicer->mesh->vertices;
    const int *triangles = slicer->triangles;
    int a = triangles[last], b = triangles[dgfemi_half_edge_next(last)], first_apex, i, h;
    dgfem_vec3 origin = vertices[a < b ? a : b], along = dgfemi_sub(vertices[a < b ? b : a], origin), x, y;
    first_apex = triangles[dgfemi_half_edge_next(dgfemi_half_edge_next(last))];
    x = dgfemi_sub(vertices[first_apex], origin);
    y = dgfemi_normalized(dgfemi_cross(along, x));
    x = dgfemi_normalized(dgfemi_cross(y, along));
    for (i = 0, h = last; i < count; i++, h = slicer->chain[h]) {
        int apex = triangles[dgfemi_half_edge_next(dgfemi_half_edge_next(h))];
        dgfem_vec3 d = dgfemi_sub(vertices[apex], origin);
        dgfem_real u = dgfemi_dot(d, x), v = dgfemi_dot(d, y), sum = dgfemi_abs(u) + dgfemi_abs(v);
        u = sum > 0 ? u / sum : 1;
        spokes[i].angle = apex == first_apex ? 0 : v >= 0 ? 1 - u : 3 + u;
        spokes[i].half_edge = h;
        spokes[i].closing = triangles[h] < triangles[dgfemi_half_edge_next(h)];
    }
    qsort(spokes, (size_t)count, sizeof(dgfemi_spoke), dgfemi_spoke_compare);
}

/* Pairs the triangles of each solid corner, like brackets in a circle. `stack` has room for `count`. */
static void dgfemi_slice_pair_spokes(dgfemi_slicer *slicer, const dgfemi_spoke *spokes, int count, int *stack) {
    int depth = 0, i;
    for (i = 0; i < 2 * count; i++) { /* twice around: what is left open at first is closed then */
        const dgfemi_spoke *spoke = &spokes[i % count];
        if (slicer->twin[spoke->half_edge] != DGFEM_NONE) continue;
        if (!spoke->closing) {
            if (i < count) stack[depth++] = spoke->half_edge;
        } else if (depth > 0) {
            int opening = stack[--depth];
            slicer->twin[opening] = spoke->half_edge;
            slicer->twin[spoke->half_edge] = opening;
        }
    }
}

/* Tells apart the solid corners at an edge with more than two triangles: all but the first get a vertex of their own in
   the middle, so that no two of them share an edge. */
static dgfem_status dgfemi_slice_part_edge(dgfemi_slicer *slicer, int last, int corners) {
    dgfem_mesh *mesh = slicer->mesh;
    int h, corner = 0;
    for (h = last; h != DGFEM_NONE; h = slicer->chain[h]) {
        int a = slicer->triangles[h], b = slicer->triangles[dgfemi_half_edge_next(h)];
        dgfem_vec3 pa = mesh->vertices[a], middle;
        if (a > b || corner++ == 0) continue;
        middle = dgfemi_add_scaled(pa, (dgfem_real)(corner - 1) / (dgfem_real)corners,
                                   dgfemi_sub(mesh->vertices[b], pa));
        dgfemi_lattice_snap(&slicer->lattice, &middle);
        slicer->middle[h] = slicer->middle[slicer->twin[h]] = dgfemi_mesh_add_vertex(mesh, middle);
        if (slicer->middle[h] == DGFEM_NONE) return dgfemi_fail_memory(slicer->hooks);
    }
    return DGFEM_OK;
}

/* An edge with more than two triangles: they are paired, and the pairs are told apart. */
static dgfem_status dgfemi_slice_pair_crowd(dgfemi_slicer *slicer, int last, int count) {
    const dgfem_hooks *hooks = slicer->hooks;
    dgfemi_spoke *spokes = (dgfemi_spoke *)dgfemi_allocate(hooks, (size_t)count, sizeof(dgfemi_spoke));
    int *stack = (int *)dgfemi_allocate(hooks, (size_t)count, sizeof(int));
    dgfem_status status = DGFEM_OK;
    if (spokes && stack) {
        dgfemi_slice_sort_spokes(slicer, last, spokes, count);
        dgfemi_slice_pair_spokes(slicer, spokes, count, stack);
        status = dgfemi_slice_part_edge(slicer, last, count / 2);
    } else {
        status = dgfemi_fail_memory(hooks);
    }
    dgfemi_free(hooks, spokes);
    dgfemi_free(hooks, stack);
    return status;
}

/* Pairs half-edges: two triangles at an edge are neighbours, more are taken apart into solid corners. */
static dgfem_status dgfemi_slice_pair_edges(dgfemi_slicer *slicer) {
    const dgfemi_edge_map *map = &slicer->splitter.crossings;
    dgfem_status status = DGFEM_OK;
    size_t i;
    int h;
    for (h = 0; h < 3 * slicer->count; h++) slicer->twin[h] = slicer->middle[h] = DGFEM_NONE;
    for (i = 0; !status && i < map->size; i++) {
        int last = map->slots[i].value, count = 0;
        if (!dgfemi_edge_map_has(map, &map->slots[i])) continue;
        for (h = last; h != DGFEM_NONE; h = slicer->chain[h]) count++;
        if (count > 2) status = dgfemi_slice_pair_crowd(slicer, last, count);
        else slicer->twin[last] = slicer->chain[last], slicer->twin[slicer->chain[last]] = last;
    }
    return status;
}

/* ---- shells ---- */

/* Six times the volume between a triangle and a point. */
static double dgfemi_slice_six_volume(const dgfemi_slicer *slicer, int t, dgfem_vec3 origin) {
    const dgfem_vec3 *vertices = slicer->mesh->vertices;
    const int *v = slicer->triangles + 3 * t;
    dgfem_vec3 a = dgfemi_sub(vertices[v[0]], origin), b = dgfemi_sub(vertices[v[1]], origin);
    return (double)dgfemi_dot(a, dgfemi_cross(b, dgfemi_sub(vertices[v[2]], origin)));
}

/* Turns the whole surface. */
static void dgfemi_slice_flip(dgfemi_slicer *slicer) {
    int t;
    for (t = 0; t < slicer->count; t++) {
        int *v = slicer->triangles + 3 * t, swap = v[1];
        v[1] = v[2], v[2] = swap;
        slicer->normals[t] = dgfemi_scale(-1, slicer->normals[t]);
    }
}

/* The total volume must be positive, if only after a flip. */
static dgfem_status dgfemi_slice_check_volume(dgfemi_slicer *slicer) {
    dgfem_vec3 middle = dgfemi_add_scaled(slicer->lower, DGFEM_R(0.5), dgfemi_sub(slicer->upper, slicer->lower));
    double six = 0;
    int t;
    for (t = 0; t < slicer->count; t++) six += dgfemi_slice_six_volume(slicer, t, middle);
    slicer->volume = six / 6;
    if (!(six - six <= 0))
        return dgfemi_fail(slicer->hooks, DGFEM_ERROR_NOT_FINITE, "the surface's volume overflows");
    if (six < 0 && !slicer->desc->flip)
        return dgfemi_fail(slicer->hooks, DGFEM_ERROR_INSIDE_OUT, "the surface has volume %g", slicer->volume);
    if (!(six < 0)) return DGFEM_OK;
    slicer->volume = -slicer->volume;
    dgfemi_slice_flip(slicer);
    return dgfemi_slice_chain_edges(slicer); /* the half-edges have changed places */
}

/* Joins triangles that share edges. */
static void dgfemi_slice_find_shells(dgfemi_slicer *slicer) {
    int t, h;
    for (t = 0; t < slicer->count; t++) slicer->shell[t] = t;
    for (h = 0; h < 3 * slicer->count; h++) {
        int a = dgfemi_root(slicer->shell, h / 3), b = dgfemi_root(slicer->shell, slicer->twin[h] / 3);
        slicer->shell[a > b ? a : b] = a > b ? b : a;
    }
    for (t = 0; t < slicer->count; t++) slicer->shell[t] = dgfemi_root(slicer->shell, t);
}

/* How often the other shells wind around a point of this one. */
static double dgfemi_slice_winding(const dgfemi_slicer *slicer, int shell) {
    const dgfem_vec3 *vertices = slicer->mesh->vertices;
    dgfem_vec3 p = vertices[slicer->triangles[3 * shell]];
    double sum = 0;
    int t;
    for (t = 0; t < slicer->count; t++) {
        const int *v = slicer->triangles + 3 * t;
        if (slicer->shell[t] == shell) continue;
        sum += dgfemi_solid_angle(dgfemi_sub(vertices[v[0]], p), dgfemi_sub(vertices[v[1]], p),
                                  dgfemi_sub(vertices[v[2]], p));
    }
    return sum / 12.566370614359172; /* 4 pi */
}

/* Every shell must enclose a volume, and one of negative volume must be a void within the others. */
static dgfem_status dgfemi_slice_check_shells(dgfemi_slicer *slicer) {
    const size_t count = (size_t)slicer->count;
    double *six, *scale;
    int t;
    dgfemi_slice_find_shells(slicer);
    six = (double *)dgfemi_arena_allocate_zero(&slicer->arena, count, sizeof(double));
    scale = (double *)dgfemi_arena_allocate_zero(&slicer->arena, count, sizeof(double));
    if (!six || !scale) return dgfemi_fail_memory(slicer->hooks);
    for (t = 0; t < slicer->count; t++) {
        int shell = slicer->shell[t];
        double s = dgfemi_slice_six_volume(slicer, t, slicer->mesh->vertices[slicer->triangles[3 * shell]]);
        six[shell] += s;
        scale[shell] += fabs(s);
    }
    for (t = 0; t < slicer->count; t++) {
        if (slicer->shell[t] != t) continue;
        if (!(fabs(six[t]) > 8 * (double)DGFEM_EPSILON * scale[t]))
            return dgfemi_fail(slicer->hooks, DGFEM_ERROR_DEGENERATE, "the part at triangle %d has no volume", t);
        if (six[t] < 0 && !(dgfemi_slice_winding(slicer, t) > 0.25))
            return dgfemi_fail(slicer->hooks, DGFEM_ERROR_INSIDE_OUT,
                               "the part at triangle %d has volume %g and is no void inside another", t, six[t] / 6);
    }
    return DGFEM_OK;
}

/* ---- cutting ---- */

/* The surface as a mesh of one element, not measured. */
static dgfem_status dgfemi_slice_begin_mesh(dgfemi_slicer *slicer) {
    dgfem_mesh *mesh = slicer->mesh;
    int t, count = slicer->count;
    if (!dgfemi_mesh_reserve(mesh, 2 * count, 6 * count, 64, 6 * count, 24 * count, 12 * count))
        return dgfemi_fail_memory(slicer->hooks);
    for (t = 0; t < count; t++) {
        int loop[6], corners = 0, h;
        for (h = 3 * t; h < 3 * t + 3; h++) {
            loop[corners++] = slicer->triangles[h];
            if (slicer->middle[h] != DGFEM_NONE) loop[corners++] = slicer->middle[h];
        }
        mesh->element_faces[t] = dgfemi_mesh_add_face(mesh, dgfemi_mesh_add_loop(mesh, loop, corners), 1, 0, DGFEM_NONE, t,
                                                      slicer->normals[t]);
    }
    mesh->element_face_count = count;
    mesh->element_count = 1;
    memset(mesh->elements, 0, sizeof(dgfem_element));
    mesh->elements[0].face_count = count;
    return DGFEM_OK;
}

/* Room for the extents of all elements and so many more. 1 on success. */
static int dgfemi_slice_fit_extents(dgfemi_slicer *slicer, int extra) {
    const dgfem_mesh *mesh = slicer->mesh;
    void *low = slicer->low, *high = slicer->high;
    int ok = dgfemi_mesh_room(slicer->hooks, &low, mesh->element_count, &slicer->low_capacity, extra, sizeof(dgfem_real));
    slicer->low = (dgfem_real *)low;
    ok = ok && dgfemi_mesh_room(slicer->hooks, &high, mesh->element_count, &slicer->high_capacity, extra,
                                sizeof(dgfem_real));
    slicer->high = (dgfem_real *)high;
    return ok;
}

static void dgfemi_slice_measure_extent(dgfemi_slicer *slicer, int element) {
    const dgfem_mesh *mesh = slicer->mesh;
    const dgfem_element *e = &mesh->elements[element];
    dgfemi_splitter *s = &slicer->splitter;
    int k;
    for (k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_real *extent = s->extent + 2 * (size_t)mesh->element_faces[k];
        if (extent[0] > extent[1]) dgfemi_split_measure_extent(s, mesh->element_faces[k]);
        if (k == e->face_start) slicer->low[element] = extent[0], slicer->high[element] = extent[1];
        slicer->low[element] = dgfemi_min(slicer->low[element], extent[0]);
        slicer->high[element] = dgfemi_max(slicer->high[element], extent[1]);
    }
}

/* Splits all elements that straddle one plane. */
static dgfem_status dgfemi_slice_cut_plane(dgfemi_slicer *slicer, dgfem_real plane) {
    dgfemi_splitter *s = &slicer->splitter;
    const dgfem_mesh *mesh = slicer->mesh;
    dgfem_status status;
    int e, c;
    s->low = s->high = plane;
    s->selected.count = 0;
    for (e = 0; e < mesh->element_count; e++)
        if (slicer->low[e] < plane && plane < slicer->high[e] && !dgfemi_push(slicer->hooks, &s->selected, e))
            return dgfemi_fail_memory(slicer->hooks);
    if (s->selected.count == 0) return DGFEM_OK;
    if (!dgfemi_slice_fit_extents(slicer, s->selected.count)) return dgfemi_fail_memory(slicer->hooks);
    status = dgfemi_split_straddling(s, s->selected.data, s->selected.count);
    for (c = 0; !status && c < s->child_count; c++) {
        const dgfemi_split_child *child = &s->children[c];
        if (child->side < 0) continue;
        slicer->low[child->element] = plane, slicer->high[child->element] = slicer->high[child->parent];
        slicer->high[child->parent] = plane;
    }
    return status;
}

/* The cell along one axis of an element that lies between two of its planes; the outermost cells have no end. */
static int dgfemi_slice_cell(const dgfemi_slicer *slicer, int axis, int element) {
    const dgfemi_lattice *lattice = &slicer->lattice;
    dgfem_real middle = slicer->low[element] + (slicer->high[element] - slicer->low[element]) / 2;
    dgfem_real guess = (middle - lattice->lower[axis]) / lattice->cell[axis];
    int last = lattice->cells[axis] - 1;
    int cell = guess < 1 ? 0 : guess > (dgfem_real)last ? last : (int)guess;
    while (cell > 0 && dgfemi_lattice_plane(lattice, axis, cell) > middle) cell--;
    while (cell < last && dgfemi_lattice_plane(lattice, axis, cell + 1) <= middle) cell++;
    return cell;
}

/* All planes across one axis, the middle ones first: then an element takes part in few of the cuts. */
static dgfem_status dgfemi_slice_cut_axis(dgfemi_slicer *slicer, int axis, int stride) {
    dgfem_mesh *mesh = slicer->mesh;
    dgfem_status status = DGFEM_OK;
    int cells = slicer->lattice.cells[axis], step = 1, index, e;
    if (!dgfemi_slice_fit_extents(slicer, 0) || !dgfemi_split_set_axis(&slicer->splitter, axis)) return dgfemi_fail_memory(slicer->hooks);
    for (e = 0; e < mesh->element_count; e++) dgfemi_slice_measure_extent(slicer, e);
    while (step <= (cells - 1) / 2) step *= 2;
    for (; step > 0; step /= 2)
        for (index = step; index < cells; index += 2 * step) {
            status = dgfemi_slice_cut_plane(slicer, dgfemi_lattice_plane(&slicer->lattice, axis, index));
            if (status) return status;
            if (index > INT_MAX - 2 * step) break;
        }
    for (e = 0; e < mesh->element_count; e++) mesh->elements[e].tag += stride * dgfemi_slice_cell(slicer, axis, e);
    return status;
}

static dgfem_status dgfemi_slice_cut(dgfemi_slicer *slicer) {
    const int *cells = slicer->lattice.cells;
    dgfem_status status = dgfemi_slice_cut_axis(slicer, 0, 1);
    if (!status) status = dgfemi_slice_cut_axis(slicer, 1, cells[0]);
    if (!status) status = dgfemi_slice_cut_axis(slicer, 2, cells[0] * cells[1]);
    return status;
}

/* ---- components ---- */

/* Of the components in a cell, only those that are whole shells can be voids: the others have a cap, and beyond it is
   the outside. These get no negative volume, whatever round-off says. */
static int dgfemi_slice_measure_parts(dgfemi_slicer *slicer) {
    dgfemi_parts *parts = &slicer->splitter.parts;
    int i, k;
    if (!dgfemi_parts_measure(parts)) return 0;
    for (i = 0; i < parts->count; i++) parts->parent[i] = 0; /* from here on: has a cap */
    for (k = 0; k < parts->code_count; k++)
        if (slicer->mesh->faces[parts->codes[k] / 2].element[1] != DGFEM_NONE) parts->parent[parts->component[k]] = 1;
    for (i = 0; i < parts->count; i++)
        if (parts->parent[i] && !(parts->volume[i] > 0)) parts->volume[i] = DGFEM_R(1e-37);
    return 1;
}

/* Appends the faces of one component as an element in place of its parent. */
static dgfem_status dgfemi_slice_add_element(dgfemi_slicer *slicer, int parent, int component) {
    dgfem_mesh *mesh = slicer->mesh;
    const dgfemi_parts *parts = &slicer->splitter.parts;
    dgfemi_ints *faces = &slicer->splitter.scratch_a;
    int k, element;
    faces->count = 0;
    for (k = 0; k < parts->code_count; k++)
        if (parts->component[k] == component && !dgfemi_push(slicer->hooks, faces, parts->codes[k] / 2))
            return dgfemi_fail_memory(slicer->hooks);
    element = dgfemi_mesh_add_element(mesh, faces->data, faces->count, mesh->elements[parent].tag);
    if (element == DGFEM_NONE) return dgfemi_fail_memory(slicer->hooks);
    for (k = 0; k < faces->count; k++) {
        dgfem_face *face = &mesh->faces[faces->data[k]];
        face->element[face->element[0] == parent ? 0 : 1] = element;
    }
    return DGFEM_OK;
}

/* Replaces an element by its components, which it leaves dead. */
static dgfem_status dgfemi_slice_part_element(dgfemi_slicer *slicer, int element) {
    dgfem_mesh *mesh = slicer->mesh;
    dgfemi_splitter *s = &slicer->splitter;
    dgfem_element e = mesh->elements[element];
    dgfem_status status = DGFEM_OK;
    int k, i;
    s->below.count = 0;
    for (k = e.face_start; k < e.face_start + e.face_count; k++) {
        int f = mesh->element_faces[k];
        if (!dgfemi_push(slicer->hooks, &s->below, 2 * f + (mesh->faces[f].element[0] != element)))
            return dgfemi_fail_memory(slicer->hooks);
    }
    if (!dgfemi_parts_find(&s->parts, &s->below)) return dgfemi_fail_memory(slicer->hooks);
    if (s->parts.count > 1) {
        if (!dgfemi_slice_measure_parts(slicer)) return dgfemi_fail_memory(slicer->hooks);
        status = dgfemi_parts_attach_voids(&s->parts);
    }
    for (i = 0; !status && i < s->parts.count; i++)
        if (s->parts.count == 1 || s->parts.volume[i] > 0) status = dgfemi_slice_add_element(slicer, element, i);
    mesh->elements[element].face_count = 0;
    return status;
}

typedef struct dgfemi_tagged {
    int tag, element;
} dgfemi_tagged;

static int dgfemi_tagged_compare(const void *a, const void *b) {
    const dgfemi_tagged *x = (const dgfemi_tagged *)a, *y = (const dgfemi_tagged *)b;
    if (x->tag != y->tag) return x->tag < y->tag ? -1 : 1;
    return (x->element > y->element) - (x->element < y->element);
}

/* Takes all elements apart, in the order of the grid's cells. */
static dgfem_status dgfemi_slice_part_elements(dgfemi_slicer *slicer) {
    const dgfem_mesh *mesh = slicer->mesh;
    int e, count = mesh->element_count;
    dgfemi_tagged *order = (dgfemi_tagged *)dgfemi_arena_allocate(&slicer->arena, (size_t)count, sizeof(dgfemi_tagged));
    dgfem_status status = DGFEM_OK;
    if (!order) return dgfemi_fail_memory(slicer->hooks);
    for (e = 0; e < count; e++) order[e].tag = mesh->elements[e].tag, order[e].element = e;
    qsort(order, (size_t)count, sizeof(dgfemi_tagged), dgfemi_tagged_compare);
    for (e = 0; !status && e < count; e++) status = dgfemi_slice_part_element(slicer, order[e].element);
    return status;
}

/* ---- the result ---- */

/* Merges slivers, and in any case what round-off has left without volume. */
static dgfem_status dgfemi_slice_merge(dgfemi_slicer *slicer, dgfem_slice_info *info) {
    const dgfemi_lattice *lattice = &slicer->lattice;
    dgfem_mesh *mesh = slicer->mesh;
    dgfem_real cell = lattice->cell[0] * lattice->cell[1] * lattice->cell[2];
    dgfem_real limit = dgfemi_max(slicer->desc->sliver, DGFEM_EPSILON * DGFEM_EPSILON) * cell;
    dgfem_status status = dgfem_mesh_merge_slivers(mesh, limit, &info->slivers_merged, &info->slivers_left);
    int e;
    for (e = 0; !status && e < mesh->element_count; e++)
        if (!(mesh->elements[e].volume > 0)) {
            int face = mesh->element_faces[mesh->elements[e].face_start];
            status = dgfemi_fail(slicer->hooks, DGFEM_ERROR_DEGENERATE,
                                 "cell %d: a part has volume %g (triangle %d): the surface crosses itself", mesh->elements[e].tag,
                                 (double)mesh->elements[e].volume, mesh->faces[face].tag);
        }
    return status;
}

/* Input, surface, cuts, components, measures, slivers; slicer->mesh is the result. */
static dgfem_status dgfemi_slice_run(dgfemi_slicer *slicer, dgfem_slice_info *info) {
    dgfem_status status = dgfemi_slice_read_vertices(slicer);
    if (!status) status = dgfemi_slice_read_triangles(slicer);
    if (!status) status = dgfemi_slice_set_grid(slicer);
    if (!status) status = dgfemi_slice_measure_triangles(slicer);
    if (!status) status = dgfemi_slice_chain_edges(slicer);
    if (!status) status = dgfemi_slice_check_volume(slicer);
    if (!status) status = dgfemi_slice_pair_edges(slicer);
    if (!status) status = dgfemi_slice_check_shells(slicer);
    if (!status) status = dgfemi_slice_begin_mesh(slicer);
    if (!status) status = dgfemi_slice_cut(slicer);
    if (!status) status = dgfemi_slice_part_elements(slicer);
    if (!status) status = dgfemi_mesh_compact(slicer->mesh);
    if (status) return status;
    dgfemi_mesh_measure(slicer->mesh);
    info->triangles = slicer->count;
    info->elements_raw = slicer->mesh->element_count;
    info->surface_volume = (dgfem_real)slicer->volume;
    info->surface_area = (dgfem_real)slicer->area;
    return dgfemi_slice_merge(slicer, info);
}

DGFEM_API dgfem_status dgfem_mesh_create_slices(const dgfem_slice_desc *desc, dgfem_mesh **out) {
    dgfem_slice_info info;
    dgfemi_slicer slicer;
    dgfem_status status;
    if (out) *out = NULL;
    status = dgfemi_check_cookie(desc, desc ? desc->cookie : 0);
    if (status) return status;
    if (!out) return dgfemi_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "slice: nowhere to put the mesh");
    status = dgfemi_slice_check_desc(desc);
    if (status) return status;
    memset(&slicer, 0, sizeof slicer);
    memset(&info, 0, sizeof info);
    slicer.desc = desc;
    slicer.hooks = &desc->hooks;
    slicer.count = desc->triangle_count;
    slicer.mesh = dgfemi_mesh_new(&desc->hooks);
    if (!slicer.mesh) return dgfemi_fail_memory(&desc->hooks);
    slicer.arena = dgfemi_arena_make(&desc->hooks);
    slicer.splitter = dgfemi_splitter_make(slicer.mesh);
    slicer.splitter.lattice = &slicer.lattice;
    slicer.splitter.all = 1;
    status = dgfemi_slice_run(&slicer, &info);
    dgfemi_free(&desc->hooks, slicer.low);
    dgfemi_free(&desc->hooks, slicer.high);
    dgfemi_splitter_free(&slicer.splitter);
    dgfemi_arena_free(&slicer.arena);
    if (status) {
        dgfem_mesh_destroy(slicer.mesh);
        return status;
    }
    if (desc->info) *desc->info = info;
    *out = slicer.mesh;
    return DGFEM_OK;
}
