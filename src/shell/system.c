#pragma once
#include "corotation.c"
/* The groups of all elements and edges, the block matrix of the nodes, and the shell's creation. */

/* Work vectors of all nodes. */
enum {
    DGFEM_SHELLI_X, /* trial positions */
    DGFEM_SHELLI_V, /* trial velocities */
    DGFEM_SHELLI_RESIDUAL,
    DGFEM_SHELLI_FORCE,
    DGFEM_SHELLI_RHS,
    DGFEM_SHELLI_SOLUTION,
    DGFEM_SHELLI_MOTION, /* prescribed part of an increment */
    DGFEM_SHELLI_BEST,
    DGFEM_SHELLI_KRYLOV, /* and what follows: an orthonormal basis */
    DGFEM_SHELLI_VECTORS = DGFEM_SHELLI_KRYLOV + 10
};

static dgfem_vec3 *dgfem_shelli_vector(const dgfem_shell *shell, int k) {
    return (dgfem_vec3 *)(void *)shell->system->work + (size_t)k * (size_t)shell->node_count;
}
static const dgfem_real *dgfem_shelli_reals(const dgfem_vec3 *x) { return (const dgfem_real *)(const void *)x; }
static dgfem_real *dgfem_shelli_reals_of(dgfem_vec3 *x) { return (dgfem_real *)(void *)x; }

/* ---- groups ---- */

static int dgfem_shelli_edge_has_group(const dgfem_shell_edge *edge) {
    return dgfem_shelli_is_boundary(edge) || edge->joint == DGFEM_SHELL_GLUED;
}

static void dgfem_shelli_count_groups(const dgfem_shell *shell, dgfem_shell_system *system) {
    for (int e = 0; e < shell->element_count; e++) {
        system->group_count++;
        system->point_count += dgfem_shelli_point_count(shell->elements[e].node_count);
    }
    for (int i = 0; i < shell->edge_count; i++) {
        if (!dgfem_shelli_edge_has_group(&shell->edges[i])) continue;
        system->group_count++;
        system->point_count += DGFEM_SHELLI_EDGE_POINTS;
    }
}

/* The nodes of all sides, each once. */
static void dgfem_shelli_group_nodes(const dgfem_shell *shell, dgfem_shelli_group *group, int *nodes) {
    group->node_count = 0;
    for (int side = 0; side < group->sides; side++) {
        const dgfem_shell_element *element = &shell->elements[group->element[side]];
        for (int a = 0; a < element->node_count; a++) {
            int at = 0;
            while (at < group->node_count && nodes[at] != element->node[a]) at++;
            if (at == group->node_count) nodes[group->node_count++] = element->node[a];
            group->local[side][a] = (signed char)at;
        }
    }
}

static size_t dgfem_shelli_pairs(const dgfem_shelli_group *group) {
    return (size_t)group->node_count * ((size_t)group->node_count + 1) / 2;
}

typedef struct dgfem_shelli_totals {
    size_t strains, gradients, pairs;
} dgfem_shelli_totals;

static void dgfem_shelli_add_group(const dgfem_shell *shell, dgfem_shell_system *system, dgfem_shelli_kind kind,
                                   int owner, const int *elements, int points, dgfem_shelli_totals *totals) {
    dgfem_shelli_group *group = &system->groups[system->group_count++];
    group->kind = kind;
    group->owner = owner;
    group->element[0] = elements[0];
    group->element[1] = kind == DGFEM_SHELLI_GLUE ? elements[1] : DGFEM_NONE;
    group->sides = kind == DGFEM_SHELLI_GLUE ? 2 : 1;
    group->node_start = system->node_total;
    dgfem_shelli_group_nodes(shell, group, system->nodes + group->node_start);
    system->node_total += group->node_count;
    group->point_start = system->point_count;
    group->point_count = points;
    group->map_start = totals->pairs;
    totals->pairs += dgfem_shelli_pairs(group);
    for (int q = 0; q < points; q++) {
        dgfem_shelli_point *point = &system->points[system->point_count++];
        point->strain_start = totals->strains;
        point->gradient_start = totals->gradients;
        totals->strains += (size_t)(dgfem_shelli_rows(group) * 3 * group->node_count);
        totals->gradients += (size_t)group->node_count;
    }
}

static int dgfem_shelli_lay_out(const dgfem_shell *shell, dgfem_shell_system *system, dgfem_shelli_totals *totals) {
    const dgfem_hooks *hooks = &shell->hooks;
    dgfem_shelli_count_groups(shell, system);
    size_t groups = (size_t)system->group_count, points = (size_t)system->point_count;
    system->groups = (dgfem_shelli_group *)dgfem_shelli_allocate(hooks, groups, sizeof *system->groups);
    system->points = (dgfem_shelli_point *)dgfem_shelli_allocate(hooks, points, sizeof *system->points);
    system->nodes = (int *)dgfem_shelli_allocate(hooks, DGFEM_SHELLI_MAX_GROUP * groups, sizeof(int));
    system->rotations = (dgfem_mat3 *)dgfem_shelli_allocate(hooks, points, sizeof(dgfem_mat3));
    system->strain_before =
        (dgfem_real *)dgfem_shelli_allocate(hooks, points, DGFEM_SHELLI_MAX_ROWS * sizeof(dgfem_real));
    if (!system->groups || !system->points || !system->nodes || !system->rotations || !system->strain_before) return 0;
    for (int q = 0; q < system->point_count; q++) system->rotations[q] = dgfem_shelli_identity();
    system->group_count = system->point_count = 0;
    for (int e = 0; e < shell->element_count; e++)
        dgfem_shelli_add_group(shell, system, DGFEM_SHELLI_ELEMENT, e, &e,
                               dgfem_shelli_point_count(shell->elements[e].node_count), totals);
    for (int i = 0; i < shell->edge_count; i++)
        if (dgfem_shelli_edge_has_group(&shell->edges[i]))
            dgfem_shelli_add_group(
                shell, system, dgfem_shelli_is_boundary(&shell->edges[i]) ? DGFEM_SHELLI_BOUNDARY : DGFEM_SHELLI_GLUE,
                i, shell->edges[i].element, DGFEM_SHELLI_EDGE_POINTS, totals);
    system->strains = (dgfem_real *)dgfem_shelli_allocate(hooks, totals->strains, sizeof(dgfem_real));
    system->gradients = (dgfem_vec3 *)dgfem_shelli_allocate(hooks, totals->gradients, sizeof(dgfem_vec3));
    system->group_force = (dgfem_vec3 *)dgfem_shelli_allocate(hooks, (size_t)system->node_total, sizeof(dgfem_vec3));
    system->group_energy = (dgfem_real *)dgfem_shelli_allocate(hooks, groups, sizeof(dgfem_real));
    system->dense_count = !hooks->parallel_for ? 1 : system->group_count < 128 ? system->group_count : 128;
    system->dense = (dgfem_real *)dgfem_shelli_allocate(hooks, (size_t)system->dense_count * DGFEM_SHELLI_DENSE,
                                                        sizeof(dgfem_real));
    system->map = (size_t *)dgfem_shelli_allocate(hooks, totals->pairs, sizeof(size_t));
    return system->strains && system->gradients && system->map && system->group_force && system->group_energy &&
           system->dense;
}

/* ---- matrix ---- */

static void dgfem_shelli_fill_pairs(const dgfem_shell_system *system, int *pairs) {
    for (int g = 0; g < system->group_count; g++) {
        const int *nodes = system->nodes + system->groups[g].node_start;
        for (int a = 0; a < system->groups[g].node_count; a++)
            for (int b = 0; b <= a; b++) *pairs++ = nodes[a], *pairs++ = nodes[b];
    }
}

static void dgfem_shelli_fill_map(dgfem_shell_system *system) {
    size_t *map = system->map;
    for (int g = 0; g < system->group_count; g++) {
        const int *nodes = system->nodes + system->groups[g].node_start;
        for (int a = 0; a < system->groups[g].node_count; a++)
            for (int b = 0; b <= a; b++) {
                int row = nodes[a] > nodes[b] ? nodes[a] : nodes[b], column = nodes[a] + nodes[b] - row;
                *map++ = (size_t)(dgfem_matrix_block(system->matrix, row, column) - system->matrix->values);
            }
    }
}

static dgfem_status dgfem_shelli_create_matrix(const dgfem_shell *shell, dgfem_shell_system *system, size_t pairs) {
    dgfem_shelli_scratch scratch = dgfem_shelli_scratch_make(&shell->hooks);
    dgfem_matrix_desc desc = dgfem_default_matrix_desc();
    if (pairs > (size_t)INT_MAX / 8)
        return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "%d elements are too many", shell->element_count);
    int *sizes = (int *)dgfem_shelli_take(&scratch, (size_t)shell->node_count, sizeof(int));
    int *list = (int *)dgfem_shelli_take(&scratch, 2 * pairs, sizeof(int));
    dgfem_status status = DGFEM_ERROR_MEMORY;
    if (sizes && list) {
        for (int i = 0; i < shell->node_count; i++) sizes[i] = 3;
        dgfem_shelli_fill_pairs(system, list);
        desc.block_count = shell->node_count;
        desc.block_sizes = sizes;
        desc.pairs = list;
        desc.pair_count = (int)pairs;
        desc.centres = shell->rest;
        desc.hooks = shell->hooks;
        desc.hooks.log = NULL; /* the shell has its own line */
        status = dgfem_matrix_create(&desc, &system->matrix);
    }
    dgfem_shelli_scratch_free(&scratch);
    return status;
}

static dgfem_status dgfem_shelli_create_solver(const dgfem_shell *shell, dgfem_shell_system *system, size_t pairs) {
    const dgfem_hooks *hooks = &shell->hooks;
    size_t nodes = (size_t)shell->node_count;
    dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
    dgfem_status status = dgfem_shelli_create_matrix(shell, system, pairs);
    if (status) return status;
    desc.hooks = *hooks;
    desc.hooks.log = NULL; /* a tangent that is not positive definite is no news: the step is shifted */
    status = dgfem_cholesky_create(system->matrix, &desc, &system->cholesky);
    if (status) return status;
    dgfem_shelli_fill_map(system);
    system->diagonal = (size_t *)dgfem_shelli_allocate(hooks, nodes, sizeof(size_t));
    system->held = (char *)dgfem_shelli_allocate(hooks, nodes, 1);
    system->free_part = (dgfem_mat3 *)dgfem_shelli_allocate(hooks, nodes, sizeof(dgfem_mat3));
    system->target = (dgfem_vec3 *)dgfem_shelli_allocate(hooks, nodes, sizeof(dgfem_vec3));
    system->work = (dgfem_real *)dgfem_shelli_allocate(hooks, DGFEM_SHELLI_VECTORS * nodes, sizeof(dgfem_vec3));
    if (!system->diagonal || !system->held || !system->free_part || !system->target || !system->work)
        return DGFEM_ERROR_MEMORY;
    for (int i = 0; i < shell->node_count; i++)
        system->diagonal[i] = (size_t)(dgfem_matrix_block(system->matrix, i, i) - system->matrix->values);
    return DGFEM_OK;
}

static void dgfem_shelli_system_destroy(const dgfem_hooks *hooks, dgfem_shell_system *system) {
    if (!system) return;
    dgfem_shelli_free(hooks, system->groups);
    dgfem_shelli_free(hooks, system->points);
    dgfem_shelli_free(hooks, system->nodes);
    dgfem_shelli_free(hooks, system->strains);
    dgfem_shelli_free(hooks, system->gradients);
    dgfem_shelli_free(hooks, system->map);
    dgfem_shelli_free(hooks, system->rotations);
    dgfem_shelli_free(hooks, system->strain_before);
    dgfem_shelli_free(hooks, system->group_force);
    dgfem_shelli_free(hooks, system->group_energy);
    dgfem_shelli_free(hooks, system->dense);
    dgfem_shelli_free(hooks, system->diagonal);
    dgfem_shelli_free(hooks, system->held);
    dgfem_shelli_free(hooks, system->free_part);
    dgfem_shelli_free(hooks, system->target);
    dgfem_shelli_free(hooks, system->work);
    dgfem_matrix_destroy(system->matrix);
    dgfem_cholesky_destroy(system->cholesky);
    dgfem_shelli_free(hooks, system);
}

/* Everything that follows from nodes, elements and edges. On failure shell->system is what could be made. */
static dgfem_status dgfem_shelli_system_create(dgfem_shell *shell) {
    dgfem_shell_system *system = (dgfem_shell_system *)dgfem_shelli_allocate(&shell->hooks, 1, sizeof *system);
    dgfem_shelli_totals totals;
    memset(&totals, 0, sizeof totals);
    shell->system = system;
    if (!system) return DGFEM_ERROR_MEMORY;
    system->part = 1;
    dgfem_shelli_tabulate(system->basis);
    if (!dgfem_shelli_lay_out(shell, system, &totals)) return DGFEM_ERROR_MEMORY;
    for (int g = 0; g < system->group_count; g++) {
        const dgfem_shelli_group *group = &system->groups[g];
        dgfem_status status = group->kind == DGFEM_SHELLI_ELEMENT ? dgfem_shelli_build_element(shell, system, group)
                                                                  : dgfem_shelli_build_edge(shell, system, group);
        if (status) return status;
    }
    return dgfem_shelli_create_solver(shell, system, totals.pairs);
}

/* ---- creation ---- */

/* What belongs to one topology: arrays by node, element and edge, and the system. */
static void dgfem_shelli_free_topology(dgfem_shell *shell) {
    const dgfem_hooks *hooks = &shell->hooks;
    dgfem_shelli_free(hooks, shell->rest);
    dgfem_shelli_free(hooks, shell->position);
    dgfem_shelli_free(hooks, shell->velocity);
    dgfem_shelli_free(hooks, shell->node_area);
    dgfem_shelli_free(hooks, shell->node_mass);
    dgfem_shelli_free(hooks, shell->node_load);
    dgfem_shelli_free(hooks, shell->node_half);
    dgfem_shelli_free(hooks, shell->node_spring);
    dgfem_shelli_free(hooks, shell->elements);
    dgfem_shelli_free(hooks, shell->edges);
    dgfem_shelli_system_destroy(hooks, shell->system);
}

static int dgfem_shelli_allocate_nodes(dgfem_shell *shell) {
    const dgfem_hooks *hooks = &shell->hooks;
    size_t n = (size_t)shell->node_count;
    shell->rest = (dgfem_vec3 *)dgfem_shelli_allocate(hooks, n, sizeof(dgfem_vec3));
    shell->position = (dgfem_vec3 *)dgfem_shelli_allocate(hooks, n, sizeof(dgfem_vec3));
    shell->velocity = (dgfem_vec3 *)dgfem_shelli_allocate(hooks, n, sizeof(dgfem_vec3));
    shell->node_area = (dgfem_real *)dgfem_shelli_allocate(hooks, n, sizeof(dgfem_real));
    shell->node_mass = (dgfem_real *)dgfem_shelli_allocate(hooks, n, sizeof(dgfem_real));
    shell->node_load = (dgfem_real *)dgfem_shelli_allocate(hooks, n, sizeof(dgfem_real));
    shell->node_half = (dgfem_real *)dgfem_shelli_allocate(hooks, n, sizeof(dgfem_real));
    shell->node_spring = (dgfem_real *)dgfem_shelli_allocate(hooks, n, sizeof(dgfem_real));
    return shell->rest && shell->position && shell->velocity && shell->node_area && shell->node_mass &&
           shell->node_load && shell->node_half && shell->node_spring;
}

static int dgfem_shelli_allocate_elements(dgfem_shell *shell) {
    const dgfem_hooks *hooks = &shell->hooks;
    size_t n = (size_t)shell->element_count;
    shell->elements = (dgfem_shell_element *)dgfem_shelli_allocate(hooks, n, sizeof(dgfem_shell_element));
    shell->edges = (dgfem_shell_edge *)dgfem_shelli_allocate(hooks, 4 * n, sizeof(dgfem_shell_edge));
    return shell->elements && shell->edges;
}

static dgfem_status dgfem_shelli_build(dgfem_shell *shell, const dgfem_shell_desc *desc) {
    int given;
    shell->element_count = desc->quad_count + desc->triangle_count;
    if (!dgfem_shelli_allocate_elements(shell)) return DGFEM_ERROR_MEMORY;
    dgfem_status status = dgfem_shelli_read_elements(shell, desc, &given);
    if (status) return status;
    shell->node_count = given ? desc->vertices.count : dgfem_shelli_number_middles(shell, desc->vertices.count);
    if (!shell->node_count || !dgfem_shelli_allocate_nodes(shell)) return DGFEM_ERROR_MEMORY;
    status = dgfem_shelli_read_vertices(shell, desc);
    if (!status && !given) status = dgfem_shelli_place_middles(shell, desc);
    if (!status) status = dgfem_shelli_check_used(shell);
    if (!status && given) status = dgfem_shelli_check_given(shell);
    if (!status) status = dgfem_shelli_connect(shell);
    if (!status) status = dgfem_shelli_measure(shell);
    if (!status) status = dgfem_shelli_check_convex(shell);
    if (status) return status;
    memcpy(shell->position, shell->rest, (size_t)shell->node_count * sizeof *shell->rest);
    return dgfem_shelli_system_create(shell);
}

DGFEM_API dgfem_status dgfem_shell_create(const dgfem_shell_desc *desc, dgfem_shell **out) {
    if (!out) return DGFEM_ERROR_ARGUMENT;
    *out = NULL;
    if (!desc || desc->cookie != DGFEM_SHELL_COOKIE) return DGFEM_ERROR_DESCRIPTOR;
    dgfem_status status = dgfem_shelli_check_desc(desc);
    if (status) return status;
    dgfem_shell *shell = (dgfem_shell *)dgfem_shelli_allocate(&desc->hooks, 1, sizeof *shell);
    if (!shell) return dgfem_shelli_fail_memory(&desc->hooks);
    shell->desc = *desc;
    shell->hooks = desc->hooks;
    memset(&shell->desc.vertices, 0, sizeof shell->desc.vertices); /* the caller's arrays need not outlive this call */
    shell->desc.quads = shell->desc.triangles = NULL;
    shell->desc.thicknesses = NULL;
    shell->desc.materials = NULL;
    status = dgfem_shelli_build(shell, desc);
    if (status) {
        dgfem_shell_destroy(shell);
        return status == DGFEM_ERROR_MEMORY ? dgfem_shelli_fail_memory(&desc->hooks) : status;
    }
    *out = shell;
    return DGFEM_OK;
}

DGFEM_API void dgfem_shell_destroy(dgfem_shell *shell) {
    if (!shell) return;
    dgfem_hooks hooks = shell->hooks;
    for (int i = 0; i < shell->condition_count; i++) dgfem_shelli_free(&hooks, shell->conditions[i].items);
    dgfem_shelli_free(&hooks, shell->conditions);
    dgfem_shelli_free(&hooks, shell->shapes);
    dgfem_shelli_free_topology(shell);
    dgfem_shelli_free(&hooks, shell);
}
