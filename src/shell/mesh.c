#pragma once
#include "shape.c"
/* From vertices and polygons to elements with middle nodes and edges. */

DGFEM_API dgfem_shell_desc dgfem_default_shell_desc(void) {
    dgfem_shell_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_SHELL_COOKIE;
    desc.nodes_per_quad = 4;
    desc.nodes_per_triangle = 3;
    desc.thickness = DGFEM_R(0.001);
    desc.material.young = DGFEM_R(1e9);
    desc.material.poisson = DGFEM_R(0.3);
    desc.material.density = 1000;
    desc.eta_quad = 2;
    desc.eta_triangle = 1;
    desc.gravity.z = DGFEM_R(-9.81);
    desc.corotational = 1;
    desc.step_iterations = 4;
    desc.step_tolerance = DGFEM_R(1e-4);
    return desc;
}

/* ---- checks ---- */

static dgfem_status dgfem_shelli_check_material(const dgfem_hooks *hooks, const dgfem_material *m, dgfem_real thickness,
                                                int element) {
    if (!(m->young > 0) || !dgfem_shelli_is_finite(m->young))
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_MATERIAL, "element %d: Young's modulus %g, expected > 0", element,
                                 (double)m->young);
    if (!(m->poisson > -1 && m->poisson < DGFEM_R(0.5)) && !(m->poisson == DGFEM_R(0.5)))
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_MATERIAL, "element %d: Poisson's ratio %g, expected in (-1, 0.5]",
                                 element, (double)m->poisson);
    if (!(m->density > 0) || !dgfem_shelli_is_finite(m->density))
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_MATERIAL, "element %d: density %g, expected > 0", element,
                                 (double)m->density);
    if (!(thickness > 0) || !dgfem_shelli_is_finite(thickness))
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_MATERIAL, "element %d: thickness %g, expected > 0", element,
                                 (double)thickness);
    return DGFEM_OK;
}

static dgfem_status dgfem_shelli_check_scalar(const dgfem_hooks *hooks, dgfem_real value, int positive,
                                              const char *what) {
    if ((positive ? value > 0 : value >= 0) && dgfem_shelli_is_finite(value)) return DGFEM_OK;
    return dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s is %g, expected %s 0", what, (double)value,
                             positive ? ">" : ">=");
}

static dgfem_status dgfem_shelli_check_numbers(const dgfem_shell_desc *desc) {
    const dgfem_hooks *hooks = &desc->hooks;
    dgfem_status status = dgfem_shelli_check_scalar(hooks, desc->eta_quad, 1, "eta_quad");
    if (!status) status = dgfem_shelli_check_scalar(hooks, desc->eta_triangle, 1, "eta_triangle");
    if (!status) status = dgfem_shelli_check_scalar(hooks, desc->damping_mass, 0, "damping_mass");
    if (!status) status = dgfem_shelli_check_scalar(hooks, desc->damping_stiffness, 0, "damping_stiffness");
    if (!status) status = dgfem_shelli_check_scalar(hooks, desc->step_tolerance, 0, "step_tolerance");
    if (!status && desc->step_iterations < 1)
        status = dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "step_iterations is %d, expected >= 1",
                                   desc->step_iterations);
    if (!status && !dgfem_shelli_is_finite3(desc->gravity))
        status = dgfem_shelli_fail(hooks, DGFEM_ERROR_NOT_FINITE, "gravity (%g, %g, %g)", (double)desc->gravity.x,
                                   (double)desc->gravity.y, (double)desc->gravity.z);
    for (int e = 0; !status && e < desc->quad_count + desc->triangle_count; e++)
        status = dgfem_shelli_check_material(hooks, desc->materials ? &desc->materials[e] : &desc->material,
                                             desc->thicknesses ? desc->thicknesses[e] : desc->thickness, e);
    return status;
}

static dgfem_status dgfem_shelli_check_desc(const dgfem_shell_desc *desc) {
    const dgfem_hooks *hooks = &desc->hooks;
    dgfem_status status = dgfem_shelli_check_points(hooks, &desc->vertices, "vertices");
    if (status) return status;
    if (desc->quad_count < 0 || (desc->quad_count > 0 && !desc->quads))
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "no indices of %d quads", desc->quad_count);
    if (desc->triangle_count < 0 || (desc->triangle_count > 0 && !desc->triangles))
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "no indices of %d triangles", desc->triangle_count);
    /* Fewer are too many for the matrix; with these limits no count on the way there leaves an int. */
    if (desc->quad_count > INT_MAX / 128 || desc->triangle_count > INT_MAX / 128 || desc->vertices.count > INT_MAX / 2)
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "%d quads, %d triangles and %d vertices are too many",
                                 desc->quad_count, desc->triangle_count, desc->vertices.count);
    if (desc->quad_count + desc->triangle_count == 0) return dgfem_shelli_fail(hooks, DGFEM_ERROR_EMPTY, "no elements");
    if ((desc->nodes_per_quad != 4 && desc->nodes_per_quad != 8) ||
        (desc->nodes_per_triangle != 3 && desc->nodes_per_triangle != 6))
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "%d nodes per quad, %d per triangle",
                                 desc->nodes_per_quad, desc->nodes_per_triangle);
    if (desc->quad_count && desc->triangle_count && (desc->nodes_per_quad == 8) != (desc->nodes_per_triangle == 6))
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "middle nodes are given for one kind of element only");
    return dgfem_shelli_check_numbers(desc);
}

/* ---- elements ---- */

static int dgfem_shelli_is_quad(const dgfem_shell_element *element) { return element->node_count == 8; }
static int dgfem_shelli_corners(const dgfem_shell_element *element) { return element->node_count / 2; }

static void dgfem_shelli_gather(const dgfem_vec3 *x, const int *nodes, int count, dgfem_vec3 *out) {
    int a = 0;
    do out[a] = x[nodes[a]]; /* there is always one: compilers see that `out` is set */
    while (++a < count);
}

static dgfem_status dgfem_shelli_check_element(const dgfem_hooks *hooks, const dgfem_shell_element *element, int e,
                                               int given, int vertex_count) {
    for (int a = 0; a < given; a++) {
        if (element->node[a] < 0 || element->node[a] >= vertex_count)
            return dgfem_shelli_fail(hooks, DGFEM_ERROR_INDEX, "element %d: vertex %d of %d", e, element->node[a],
                                     vertex_count);
        for (int b = 0; b < a; b++)
            if (element->node[a] == element->node[b])
                return dgfem_shelli_fail(hooks, DGFEM_ERROR_DEGENERATE, "element %d has the vertex %d twice", e,
                                         element->node[a]);
    }
    return DGFEM_OK;
}

/* Copies indices, thickness and material. *given: whether middle nodes are given. */
static dgfem_status dgfem_shelli_read_elements(dgfem_shell *shell, const dgfem_shell_desc *desc, int *given) {
    *given = desc->quad_count ? desc->nodes_per_quad == 8 : desc->nodes_per_triangle == 6;
    for (int e = 0; e < shell->element_count; e++) {
        dgfem_shell_element *element = &shell->elements[e];
        int quad = e < desc->quad_count, count = quad ? desc->nodes_per_quad : desc->nodes_per_triangle;
        const int *from = quad ? desc->quads + (size_t)e * (size_t)count
                               : desc->triangles + (size_t)(e - desc->quad_count) * (size_t)count;
        element->node_count = quad ? 8 : 6;
        memcpy(element->node, from, (size_t)count * sizeof(int));
        element->tag = e;
        element->thickness = desc->thicknesses ? desc->thicknesses[e] : desc->thickness;
        element->material = desc->materials ? desc->materials[e] : desc->material;
        dgfem_status status = dgfem_shelli_check_element(&desc->hooks, element, e, count, desc->vertices.count);
        if (status) return status;
    }
    return DGFEM_OK;
}

/* ---- middle nodes ---- */

/* Open addressing from the corners of an edge to its middle node. */
typedef struct dgfem_shelli_pair {
    int a, b, middle; /* a < b; middle is 0 in an empty slot: numbers are kept plus one */
} dgfem_shelli_pair;

static dgfem_shelli_pair *dgfem_shelli_find_pair(dgfem_shelli_pair *table, size_t mask, int a, int b) {
    if (a > b) {
        int swap = a;
        a = b, b = swap;
    }
    uint64_t key = ((uint64_t)(uint32_t)a << 32 | (uint32_t)b) * 0x9e3779b97f4a7c15u;
    for (size_t slot = (size_t)(key >> 24) & mask;; slot = (slot + 1) & mask) {
        dgfem_shelli_pair *pair = &table[slot];
        if (!pair->middle) pair->a = a, pair->b = b;
        if (!pair->middle || (pair->a == a && pair->b == b)) return pair;
    }
}

static size_t dgfem_shelli_pair_table_size(const dgfem_shell *shell) {
    size_t size = 16;
    while (size < 8 * (size_t)shell->element_count) size *= 2;
    return size;
}

/* Numbers a middle node for every edge, behind the vertices. Returns the number of all nodes, 0 when out of memory. */
static int dgfem_shelli_number_middles(dgfem_shell *shell, int vertex_count) {
    dgfem_shelli_scratch scratch = dgfem_shelli_scratch_make(&shell->hooks);
    size_t size = dgfem_shelli_pair_table_size(shell);
    int next = vertex_count;
    dgfem_shelli_pair *table = (dgfem_shelli_pair *)dgfem_shelli_take(&scratch, size, sizeof *table);
    if (!table) return 0;
    for (int e = 0; e < shell->element_count; e++) {
        dgfem_shell_element *element = &shell->elements[e];
        int corners = dgfem_shelli_corners(element);
        for (int k = 0; k < corners; k++) {
            dgfem_shelli_pair *pair =
                dgfem_shelli_find_pair(table, size - 1, element->node[k], element->node[(k + 1) % corners]);
            if (!pair->middle) pair->middle = ++next;
            element->node[corners + k] = pair->middle - 1;
        }
    }
    dgfem_shelli_scratch_free(&scratch);
    return next;
}

static dgfem_status dgfem_shelli_read_vertices(dgfem_shell *shell, const dgfem_shell_desc *desc) {
    for (int i = 0; i < desc->vertices.count; i++) {
        shell->rest[i] = dgfem_shelli_read_point(&desc->vertices, i);
        if (!dgfem_shelli_is_finite3(shell->rest[i]))
            return dgfem_shelli_fail(&desc->hooks, DGFEM_ERROR_NOT_FINITE, "vertex %d", i);
    }
    return DGFEM_OK;
}

static dgfem_status dgfem_shelli_place_middles(dgfem_shell *shell, const dgfem_shell_desc *desc) {
    for (int e = 0; e < shell->element_count; e++) {
        const dgfem_shell_element *element = &shell->elements[e];
        int corners = dgfem_shelli_corners(element);
        for (int k = 0; k < corners; k++) {
            dgfem_vec3 a = shell->rest[element->node[k]], b = shell->rest[element->node[(k + 1) % corners]];
            dgfem_vec3 x = dgfem_shelli_scale(DGFEM_R(0.5), dgfem_shelli_add(a, b));
            if (desc->surface) x = desc->surface(desc->surface_user, x, a, b);
            if (!dgfem_shelli_is_finite3(x))
                return dgfem_shelli_fail(&desc->hooks, DGFEM_ERROR_NOT_FINITE,
                                         "element %d: the surface gave no place for the middle of side %d", e, k);
            shell->rest[element->node[corners + k]] = x;
        }
    }
    return DGFEM_OK;
}

static dgfem_status dgfem_shelli_check_used(const dgfem_shell *shell) {
    dgfem_shelli_scratch scratch = dgfem_shelli_scratch_make(&shell->hooks);
    char *used = (char *)dgfem_shelli_take(&scratch, (size_t)shell->node_count, 1);
    dgfem_status status = used ? DGFEM_OK : DGFEM_ERROR_MEMORY;
    for (int e = 0; !status && e < shell->element_count; e++)
        for (int a = 0; a < shell->elements[e].node_count; a++) used[shell->elements[e].node[a]] = 1;
    for (int i = 0; !status && i < shell->node_count; i++)
        if (!used[i])
            status = dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "vertex %d belongs to no element", i);
    dgfem_shelli_scratch_free(&scratch);
    return status;
}

/* ---- given middle nodes ---- */

/* No node is a corner of one element and a middle of another: role[i] > 0 is a corner of element role[i] - 1, < 0 a
   middle. */
static dgfem_status dgfem_shelli_check_roles(const dgfem_shell *shell, int *role) {
    for (int e = 0; e < shell->element_count; e++) {
        const dgfem_shell_element *element = &shell->elements[e];
        for (int a = 0; a < element->node_count; a++) {
            int corner = a < dgfem_shelli_corners(element), i = element->node[a], other = role[i];
            if (other && (other > 0) != corner)
                return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_NOT_CONFORMING,
                                         "vertex %d is a corner of element %d and the middle of a side of element %d",
                                         i, corner ? e : other - 1, corner ? -other - 1 : e);
            role[i] = corner ? e + 1 : -e - 1;
        }
    }
    return DGFEM_OK;
}

/* No two sides between the same corners have different middles. */
static dgfem_status dgfem_shelli_check_middles(const dgfem_shell *shell, dgfem_shelli_pair *table, size_t mask) {
    for (int e = 0; e < shell->element_count; e++) {
        const dgfem_shell_element *element = &shell->elements[e];
        int corners = dgfem_shelli_corners(element);
        for (int k = 0; k < corners; k++) {
            int a = element->node[k], b = element->node[(k + 1) % corners], middle = element->node[corners + k];
            dgfem_shelli_pair *pair = dgfem_shelli_find_pair(table, mask, a, b);
            if (pair->middle && pair->middle != middle + 1)
                return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_NOT_CONFORMING,
                                         "element %d: the side of vertices %d and %d has the middle node %d, that of "
                                         "another element %d",
                                         e, a, b, middle, pair->middle - 1);
            pair->middle = middle + 1;
        }
    }
    return DGFEM_OK;
}

static dgfem_status dgfem_shelli_check_given(const dgfem_shell *shell) {
    dgfem_shelli_scratch scratch = dgfem_shelli_scratch_make(&shell->hooks);
    size_t size = dgfem_shelli_pair_table_size(shell);
    int *role = (int *)dgfem_shelli_take(&scratch, (size_t)shell->node_count, sizeof(int));
    dgfem_shelli_pair *table = (dgfem_shelli_pair *)dgfem_shelli_take(&scratch, size, sizeof *table);
    dgfem_status status = role && table ? DGFEM_OK : DGFEM_ERROR_MEMORY;
    if (!status) status = dgfem_shelli_check_roles(shell, role);
    if (!status) status = dgfem_shelli_check_middles(shell, table, size - 1);
    dgfem_shelli_scratch_free(&scratch);
    return status;
}

/* ---- edges ---- */

static void dgfem_shelli_new_edge(dgfem_shell *shell, int e, int k, int middle) {
    dgfem_shell_edge *edge = &shell->edges[shell->edge_count];
    dgfem_shell_element *element = &shell->elements[e];
    memset(edge, 0, sizeof *edge);
    edge->node[0] = element->node[k];
    edge->node[1] = element->node[(k + 1) % dgfem_shelli_corners(element)];
    edge->node[2] = middle;
    edge->element[0] = e, edge->element[1] = DGFEM_NONE;
    edge->side[0] = k, edge->side[1] = DGFEM_NONE;
    edge->loop = edge->support = DGFEM_NONE;
    element->edge[k] = shell->edge_count++;
}

static dgfem_status dgfem_shelli_join_edge(dgfem_shell *shell, int e, int k, int index) {
    dgfem_shell_edge *edge = &shell->edges[index];
    dgfem_shell_element *element = &shell->elements[e];
    int a = element->node[k], b = element->node[(k + 1) % dgfem_shelli_corners(element)];
    if (edge->element[1] != DGFEM_NONE)
        return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_NOT_CONFORMING,
                                 "the edge of vertices %d and %d belongs to elements %d, %d and %d", a, b,
                                 edge->element[0], edge->element[1], e);
    if (edge->node[0] == a && edge->node[1] == b)
        return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_INSIDE_OUT,
                                 "elements %d and %d run the same way along the edge of vertices %d and %d",
                                 edge->element[0], e, a, b);
    if (edge->node[0] != b || edge->node[1] != a || edge->element[0] == e)
        return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_NOT_CONFORMING,
                                 "elements %d and %d share the middle node %d of different edges", edge->element[0], e,
                                 edge->node[2]);
    edge->element[1] = e;
    edge->side[1] = k;
    element->edge[k] = index;
    return DGFEM_OK;
}

static int dgfem_shelli_is_boundary(const dgfem_shell_edge *edge) { return edge->element[1] == DGFEM_NONE; }

/* The boundary edge that follows: around the end node through the elements, as far as they hang together by edges. */
static int dgfem_shelli_next_boundary(const dgfem_shell *shell, int edge) {
    int e = shell->edges[edge].element[0], side = shell->edges[edge].side[0];
    for (;;) {
        int next = shell->elements[e].edge[(side + 1) % dgfem_shelli_corners(&shell->elements[e])];
        const dgfem_shell_edge *candidate = &shell->edges[next];
        if (dgfem_shelli_is_boundary(candidate)) return next;
        int other = candidate->element[0] == e;
        e = candidate->element[other];
        side = candidate->side[other];
    }
}

/* Numbers the loops of the boundary in the order of their lowest edges. */
static void dgfem_shelli_number_loops(dgfem_shell *shell) {
    int loops = 0;
    for (int first = 0; first < shell->edge_count; first++) {
        int edge = first;
        if (!dgfem_shelli_is_boundary(&shell->edges[first]) || shell->edges[first].loop != DGFEM_NONE) continue;
        do {
            shell->edges[edge].loop = loops;
            edge = dgfem_shelli_next_boundary(shell, edge);
        } while (edge != first);
        loops++;
    }
}

/* Finds all edges by their middle nodes: shell->edges has room for one per side. */
static dgfem_status dgfem_shelli_connect(dgfem_shell *shell) {
    dgfem_shelli_scratch scratch = dgfem_shelli_scratch_make(&shell->hooks);
    int *edge_of = (int *)dgfem_shelli_take(&scratch, (size_t)shell->node_count, sizeof(int));
    dgfem_status status = edge_of ? DGFEM_OK : DGFEM_ERROR_MEMORY;
    shell->edge_count = 0;
    for (int i = 0; !status && i < shell->node_count; i++) edge_of[i] = DGFEM_NONE;
    for (int e = 0; !status && e < shell->element_count; e++) {
        int corners = dgfem_shelli_corners(&shell->elements[e]);
        for (int k = 0; !status && k < corners; k++) {
            int middle = shell->elements[e].node[corners + k];
            if (edge_of[middle] != DGFEM_NONE) {
                status = dgfem_shelli_join_edge(shell, e, k, edge_of[middle]);
            } else {
                edge_of[middle] = shell->edge_count;
                dgfem_shelli_new_edge(shell, e, k, middle);
            }
        }
    }
    if (!status) dgfem_shelli_number_loops(shell);
    dgfem_shelli_scratch_free(&scratch);
    return status;
}

/* ---- measures ---- */

/* Length of a side at rest. */
static dgfem_real dgfem_shelli_side_length(const dgfem_vec3 *x, int n, int side) {
    dgfem_shelli_parameter p = dgfem_shelli_corner(n, side), r = dgfem_shelli_corner(n, (side + 1) % (n / 2));
    dgfem_real length = 0;
    for (int q = 0; q < DGFEM_SHELLI_EDGE_POINTS; q++) {
        dgfem_shelli_basis f;
        dgfem_shelli_basis_at(n, dgfem_shelli_side(n, side, dgfem_shelli_gauss_point(q)), &f);
        dgfem_vec3 tangent = dgfem_shelli_axpy(dgfem_shelli_scale((r.a - p.a) / 2, dgfem_shelli_sum(f.d1, x, n)),
                                               (r.b - p.b) / 2, dgfem_shelli_sum(f.d2, x, n));
        length += dgfem_shelli_gauss_weight(q) * dgfem_shelli_norm(tangent);
    }
    return length;
}

/* Area and perimeter of one element; part[a] and load[a]: integrals of N_a^2 and N_a. 0 where it is degenerate. */
static int dgfem_shelli_measure_element(const dgfem_shell *shell, dgfem_shell_element *element, dgfem_real *part,
                                        dgfem_real *load) {
    int n = element->node_count;
    dgfem_vec3 x[DGFEM_SHELL_MAX_NODES];
    dgfem_shelli_gather(shell->rest, element->node, n, x);
    element->area = element->perimeter = 0;
    for (int a = 0; a < n; a++) part[a] = load[a] = 0;
    for (int q = 0; q < dgfem_shelli_fine_count(n); q++) {
        dgfem_shelli_basis f;
        dgfem_shelli_frame frame;
        dgfem_real weight;
        dgfem_shelli_basis_at(n, dgfem_shelli_fine(n, q, &weight), &f);
        if (!dgfem_shelli_frame_at(&f, x, n, &frame)) return 0;
        element->area += weight * frame.j;
        for (int a = 0; a < n; a++) {
            part[a] += weight * frame.j * f.n[a] * f.n[a];
            load[a] += weight * frame.j * f.n[a];
        }
    }
    for (int k = 0; k < n / 2; k++) element->perimeter += dgfem_shelli_side_length(x, n, k);
    return 1;
}

/* 1 where the corners' normals are on the side of the one at the centre: neither concave nor tangled. */
static int dgfem_shelli_is_convex(const dgfem_vec3 *x, int n) {
    dgfem_real third = n == 8 ? 0 : DGFEM_R(1.0) / 3;
    dgfem_shelli_basis f;
    dgfem_shelli_frame centre, corner;
    dgfem_shelli_basis_at(n, dgfem_shelli_parameter_make(third, third), &f);
    if (!dgfem_shelli_frame_at(&f, x, n, &centre)) return 0;
    for (int k = 0; k < n / 2; k++) {
        dgfem_shelli_basis_at(n, dgfem_shelli_corner(n, k), &f);
        if (!dgfem_shelli_frame_at(&f, x, n, &corner) || !(dgfem_shelli_dot(corner.t, centre.t) > 0)) return 0;
    }
    return 1;
}

/* For a mesh that is given: pieces that cuts leave are taken as they are. */
static dgfem_status dgfem_shelli_check_convex(const dgfem_shell *shell) {
    for (int e = 0; e < shell->element_count; e++) {
        const dgfem_shell_element *element = &shell->elements[e];
        dgfem_vec3 x[DGFEM_SHELL_MAX_NODES];
        dgfem_shelli_gather(shell->rest, element->node, element->node_count, x);
        if (!dgfem_shelli_is_convex(x, element->node_count))
            return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_DEGENERATE, "element %d is concave or tangled", e);
    }
    return DGFEM_OK;
}

/* Measures of all elements, and what each node has of them: area and mass in proportion to the integral of N^2. */
static dgfem_status dgfem_shelli_measure(dgfem_shell *shell) {
    for (int i = 0; i < shell->node_count; i++) {
        shell->node_area[i] = shell->node_mass[i] = shell->node_load[i] = 0;
        shell->node_half[i] = shell->node_spring[i] = 0;
    }
    for (int e = 0; e < shell->element_count; e++) {
        dgfem_shell_element *element = &shell->elements[e];
        dgfem_real part[DGFEM_SHELL_MAX_NODES], load[DGFEM_SHELL_MAX_NODES], total = 0, h = element->thickness;
        if (!dgfem_shelli_measure_element(shell, element, part, load))
            return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_DEGENERATE, "element %d has no tangent plane", e);
        for (int a = 0; a < element->node_count; a++) total += part[a];
        for (int a = 0; a < element->node_count; a++) {
            dgfem_real area = element->area * part[a] / total;
            int i = element->node[a];
            shell->node_area[i] += area;
            shell->node_mass[i] += area * h * element->material.density;
            shell->node_load[i] += load[a] * h * element->material.density;
            shell->node_half[i] = dgfem_shelli_max(shell->node_half[i], h / 2);
            shell->node_spring[i] = dgfem_shelli_max(shell->node_spring[i], h * element->material.young);
        }
    }
    return DGFEM_OK;
}

/* ---- boundary ---- */

DGFEM_API int dgfem_shell_boundary(const dgfem_shell *shell, int *edges, int *loop_start) {
    int loops = 0, count = 0;
    if (!shell) return 0;
    for (int first = 0; first < shell->edge_count; first++) {
        int edge = first;
        if (shell->edges[first].loop != loops) continue; /* a loop is written from its lowest edge */
        if (loop_start) loop_start[loops] = count;
        loops++;
        do {
            if (edges) edges[count] = edge;
            count++;
            edge = dgfem_shelli_next_boundary(shell, edge);
        } while (edge != first);
    }
    if (loop_start) loop_start[loops] = count;
    return loops;
}

static int dgfem_shelli_on_plane(const dgfem_shell *shell, const dgfem_plane *plane, dgfem_real tolerance, int node) {
    dgfem_real distance = dgfem_shelli_dot(plane->normal, shell->rest[node]) - plane->offset;
    return dgfem_shelli_abs(distance) <= tolerance;
}

DGFEM_API int dgfem_shell_edges_on_plane(const dgfem_shell *shell, dgfem_plane plane, dgfem_real tolerance, int *edges,
                                         int capacity) {
    int count = 0;
    for (int i = 0; shell && i < shell->edge_count; i++) {
        const dgfem_shell_edge *edge = &shell->edges[i];
        if (!dgfem_shelli_is_boundary(edge) || !dgfem_shelli_on_plane(shell, &plane, tolerance, edge->node[0]) ||
            !dgfem_shelli_on_plane(shell, &plane, tolerance, edge->node[1]) ||
            !dgfem_shelli_on_plane(shell, &plane, tolerance, edge->node[2]))
            continue;
        if (edges && count < capacity) edges[count] = i;
        count++;
    }
    return count;
}

DGFEM_API int dgfem_shell_nodes_on_plane(const dgfem_shell *shell, dgfem_plane plane, dgfem_real tolerance, int *nodes,
                                         int capacity) {
    int count = 0;
    for (int i = 0; shell && i < shell->node_count; i++) {
        if (!dgfem_shelli_on_plane(shell, &plane, tolerance, i)) continue;
        if (nodes && count < capacity) nodes[count] = i;
        count++;
    }
    return count;
}

DGFEM_API int dgfem_shell_nearest_node(const dgfem_shell *shell, dgfem_vec3 x) {
    int nearest = DGFEM_NONE;
    dgfem_real best = 0;
    for (int i = 0; shell && i < shell->node_count; i++) {
        dgfem_vec3 d = dgfem_shelli_sub(shell->position[i], x);
        dgfem_real square = dgfem_shelli_dot(d, d);
        if (nearest == DGFEM_NONE || square < best) nearest = i, best = square;
    }
    return nearest;
}
