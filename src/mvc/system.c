#pragma once
#include "element.c"
/* What follows from a mesh and materials: nodal masses, integrals of all elements, the block matrix and its solver. */

/* Vectors of all nodes that steps and solves work with. */
enum {
    DGFEM_MVCI_RHS,
    DGFEM_MVCI_SOLUTION,
    DGFEM_MVCI_FORCE,
    DGFEM_MVCI_TARGET, /* displacements of held axes */
    DGFEM_MVCI_VECTORS
};

/* A pair of an element's nodes as part of a block of the matrix. */
typedef struct dgfem_mvci_block_part {
    int element, pair;
    int turned; /* 1: transposed */
} dgfem_mvci_block_part;

struct dgfem_mvc_system {
    int *node_start;       /* [element_count + 1] into what elements have per node: */
    int *nodes;            /*   its nodes, in the order of the rows of its stiffness */
    dgfem_real *share;     /*   mu_i */
    dgfem_vec3 *mean;      /*   <grad phi_i> */
    size_t *pair_start;    /* [element_count + 1] into what elements have per pair of nodes (a, b), b <= a: */
    dgfem_real *stiffness; /*   9 numbers, row-major, at rest */
    int *use_start;        /* [node_count + 1] into `uses` */
    int *uses;             /* positions of each node in `nodes`, ascending */
    char *held;            /* [node_count] axes held */
    dgfem_mat3 *next;      /* [element_count] rotations that become the body's when a call succeeds */
    dgfem_vec3 *work;      /* DGFEM_MVCI_VECTORS * [node_count] */
    dgfem_vec3 *local;     /* displacements of elements by position in `nodes`, then forces */
    double factor_flops;   /* of the latest factorization, before the latest cut if need be; or 0 */

    /* NULL until dgfem_mvci_prepare_solver. */
    dgfem_matrix *matrix;
    int *places;                  /* without threads: block of each pair; */
    int *part_start;              /* with threads: [blocks of the matrix + 1] into `parts`, */
    dgfem_mvci_block_part *parts; /*   what each block is the sum of, in the order of elements */
    size_t *diagonal;             /* [node_count] place of the matrix's block */
    dgfem_cholesky *cholesky;     /* or, with PCG, */
    dgfem_real *pcg_work;
};

static dgfem_vec3 *dgfem_mvci_vector(const dgfem_mvc *body, int k) {
    return body->system->work + (size_t)k * (size_t)body->node_count;
}
static dgfem_real *dgfem_mvci_reals(dgfem_vec3 *x) { return (dgfem_real *)(void *)x; }

/* ---- the elements' nodes ---- */

/* Fills node_start, nodes, pair_start and makes room for the rest; *points is the largest number of samples times nodes
   of an element, *corners that of nodes or triangles. 0 when out of memory. */
static int dgfem_mvci_lay_out(const dgfem_mvc *body, dgfem_mvc_system *system, size_t *points, int *corners) {
    const dgfem_mvci_mesh *mesh = body->mesh;
    const dgfem_hooks *hooks = &body->hooks;
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(hooks);
    size_t elements = (size_t)mesh->element_count;
    int *mark = (int *)dgfem_mvci_take(&scratch, (size_t)mesh->node_count, sizeof(int)), total = 0;
    *points = 0, *corners = dgfem_mvci_max_element_corners(mesh);
    for (int e = 0; e < mesh->element_count; e++) total += dgfem_mvci_element_corners(mesh, e);
    int *nodes = (int *)dgfem_mvci_take(&scratch, (size_t)total, sizeof(int));
    system->node_start = (int *)dgfem_mvci_allocate(hooks, elements + 1, sizeof(int));
    system->pair_start = (size_t *)dgfem_mvci_allocate(hooks, elements + 1, sizeof(size_t));
    int ok = mark && nodes && system->node_start && system->pair_start;
    for (int i = 0; ok && i < mesh->node_count; i++) mark[i] = DGFEM_NONE;
    for (int e = 0; ok && e < mesh->element_count; e++) {
        int start = system->node_start[e], face_count, triangles = 0;
        const int *faces = dgfem_mvci_element_faces(mesh, e, &face_count);
        for (int k = 0; k < face_count; k++) triangles += mesh->faces[faces[k] / 2].triangle_count;
        int count = dgfem_mvci_element_nodes(mesh, e, mark, nodes + start);
        size_t samples = (size_t)dgfem_mvci_point_count(body->desc.quadrature, count, triangles);
        if (samples * (size_t)count > *points) *points = samples * (size_t)count;
        system->node_start[e + 1] = start + count;
        system->pair_start[e + 1] = system->pair_start[e] + (size_t)count * ((size_t)count + 1) / 2;
    }
    if (ok) {
        size_t used = (size_t)system->node_start[elements];
        system->nodes = (int *)dgfem_mvci_duplicate(hooks, nodes, used, sizeof(int));
        system->share = (dgfem_real *)dgfem_mvci_allocate(hooks, used, sizeof(dgfem_real));
        system->mean = (dgfem_vec3 *)dgfem_mvci_allocate(hooks, used, sizeof(dgfem_vec3));
        system->stiffness =
            (dgfem_real *)dgfem_mvci_allocate(hooks, system->pair_start[elements], 9 * sizeof(dgfem_real));
        system->local = (dgfem_vec3 *)dgfem_mvci_allocate(hooks, 2 * used, sizeof(dgfem_vec3));
        system->use_start = (int *)dgfem_mvci_allocate(hooks, (size_t)mesh->node_count + 1, sizeof(int));
        system->uses = (int *)dgfem_mvci_allocate(hooks, used, sizeof(int));
        ok = system->nodes && system->share && system->mean && system->stiffness && system->local &&
             system->use_start && system->uses;
    }
    if (ok)
        dgfem_mvci_list_places(system->nodes, system->node_start[elements], mesh->node_count, system->use_start,
                               system->uses);
    dgfem_mvci_scratch_free(&scratch);
    return ok;
}

/* ---- integration ---- */

/* What the integration of any element needs. `index` gives the place of the mesh's nodes in the element. */
static int dgfem_mvci_shape_reserve(dgfem_mvci_scratch *scratch, int corners, size_t points, int node_count,
                                    dgfem_mvci_shape *shape, int **index) {
    size_t n = (size_t)corners;
    memset(shape, 0, sizeof *shape);
    shape->triangles = (int *)dgfem_mvci_take(scratch, 3 * n, sizeof(int));
    shape->x = (dgfem_vec3 *)dgfem_mvci_take(scratch, n, sizeof(dgfem_vec3));
    shape->kappa = (dgfem_real *)dgfem_mvci_take(scratch, n, sizeof(dgfem_real));
    shape->phi = (dgfem_real *)dgfem_mvci_take(scratch, n, sizeof(dgfem_real));
    shape->weight = (dgfem_real *)dgfem_mvci_take(scratch, 4 * n, sizeof(dgfem_real));
    shape->basis = (dgfem_real *)dgfem_mvci_take(scratch, 4 * n, sizeof(dgfem_real));
    shape->gradient = (dgfem_vec3 *)dgfem_mvci_take(scratch, points, sizeof(dgfem_vec3));
    *index = (int *)dgfem_mvci_take(scratch, (size_t)node_count, sizeof(int));
    return shape->triangles && shape->x && shape->kappa && shape->phi && shape->weight && shape->basis &&
           shape->gradient && *index;
}

/* Gathers element e. */
static void dgfem_mvci_shape_take(const dgfem_mvc *body, const dgfem_mvc_system *system, int e, int *index,
                                  dgfem_mvci_shape *shape) {
    int start = system->node_start[e];
    shape->node_count = system->node_start[e + 1] - start;
    shape->nodes = system->nodes + start;
    shape->mu = system->share + start;
    shape->mean = system->mean + start;
    for (int i = 0; i < shape->node_count; i++) {
        index[shape->nodes[i]] = i;
        shape->x[i] = body->mesh->rest[shape->nodes[i]];
    }
    shape->triangle_count = dgfem_mvci_element_triangles(body->mesh, e, shape->triangles);
    for (int i = 0; i < 3 * shape->triangle_count; i++) shape->triangles[i] = index[shape->triangles[i]];
    shape->volume = dgfem_mvci_element_measure(body->mesh, e, &shape->centre);
}

static dgfem_status dgfem_mvci_integrate_element(dgfem_mvc *body, dgfem_mvc_system *system, int e, int *index,
                                                 dgfem_mvci_shape *shape) {
    const dgfem_mvc_desc *desc = &body->desc;
    dgfem_real *stiffness = system->stiffness + 9 * system->pair_start[e];
    dgfem_mvci_shape_take(body, system, e, index, shape);
    int bad = shape->volume > 0 ? dgfem_mvci_measure_shape(shape) : 0;
    if (bad != DGFEM_NONE) {
        const int *at = shape->triangles + 3 * bad;
        return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_DEGENERATE,
                               "element %d (volume %g) is not star-shaped: its centroid is not behind the triangle of "
                               "nodes %d, %d, %d",
                               e, (double)shape->volume, shape->nodes[at[0]], shape->nodes[at[1]], shape->nodes[at[2]]);
    }
    if (!dgfem_mvci_sample_shape(shape, desc->quadrature))
        return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_DEGENERATE, "element %d is too thin to be integrated", e);
    dgfem_mvci_stiffness(shape, body->material[e], desc->b_bar && shape->node_count > 4, stiffness);
    if (desc->stabilisation > 0)
        dgfem_mvci_stabilise(
            shape, desc->stabilisation * dgfem_mvci_shear(body->material[e]) * (dgfem_real)cbrt((double)shape->volume),
            stiffness);
    body->volume[e] = shape->volume;
    body->centre[e] = shape->centre;
    return DGFEM_OK;
}

/* An element that an edit has left as it was keeps its integrals. */
static void dgfem_mvci_keep_element(dgfem_mvc *body, dgfem_mvc_system *system, int e, const dgfem_mvc *before) {
    const dgfem_mvc_system *old = before->system;
    int from = body->mesh->elements[e].from, count = system->node_start[e + 1] - system->node_start[e];
    int to_start = system->node_start[e], from_start = old->node_start[from];
    size_t pairs = system->pair_start[e + 1] - system->pair_start[e];
    DGFEM_ASSERT(count == old->node_start[from + 1] - from_start);
    memcpy(system->share + to_start, old->share + from_start, (size_t)count * sizeof *system->share);
    memcpy(system->mean + to_start, old->mean + from_start, (size_t)count * sizeof *system->mean);
    memcpy(system->stiffness + 9 * system->pair_start[e], old->stiffness + 9 * old->pair_start[from],
           9 * pairs * sizeof *system->stiffness);
    body->volume[e] = before->volume[from];
    body->centre[e] = before->centre[from];
}

/* All elements; `before`: the body before an edit, or NULL. */
static dgfem_status dgfem_mvci_integrate(dgfem_mvc *body, dgfem_mvc_system *system, const dgfem_mvc *before,
                                         size_t points, int corners) {
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(&body->hooks);
    dgfem_mvci_shape shape;
    int *index;
    dgfem_status status = DGFEM_OK;
    if (!dgfem_mvci_shape_reserve(&scratch, corners, points, body->mesh->node_count, &shape, &index))
        status = dgfem_mvci_fail_memory(&body->hooks);
    for (int e = 0; !status && e < body->mesh->element_count; e++) {
        if (before && !body->mesh->elements[e].changed) dgfem_mvci_keep_element(body, system, e, before);
        else status = dgfem_mvci_integrate_element(body, system, e, index, &shape);
    }
    dgfem_mvci_scratch_free(&scratch);
    return status;
}

/* ---- nodes ---- */

/* Masses, parts of the boundary, moduli for contact. */
static void dgfem_mvci_measure_nodes(dgfem_mvc *body, const dgfem_mvc_system *system) {
    const dgfem_mvci_mesh *mesh = body->mesh;
    for (int i = 0; i < mesh->node_count; i++) body->mass[i] = body->area[i] = body->modulus[i] = 0;
    for (int e = 0; e < mesh->element_count; e++) {
        dgfem_real radius = 0, mass = body->material[e].density * body->volume[e];
        for (int i = system->node_start[e]; i < system->node_start[e + 1]; i++)
            radius = dgfem_mvci_max(radius, dgfem_mvci_distance(mesh->rest[system->nodes[i]], body->centre[e]));
        for (int i = system->node_start[e]; i < system->node_start[e + 1]; i++) {
            int node = system->nodes[i];
            body->mass[node] += system->share[i] * mass;
            body->modulus[node] += system->share[i] * body->volume[e] * body->material[e].young / radius;
            system->work[node].x += system->share[i] * body->volume[e];
        }
    }
    for (int i = 0; i < mesh->node_count; i++) body->modulus[i] /= system->work[i].x;
    for (int f = 0; f < mesh->face_count; f++) {
        int count;
        const int *at = dgfem_mvci_face_triangles(mesh, f, &count);
        for (int t = 0; mesh->faces[f].owner[1] == DGFEM_NONE && t < count; t++, at += 3) {
            dgfem_real area = dgfem_mvci_norm(dgfem_mvci_loop_area(mesh->rest, at, 3)) / 6;
            for (int i = 0; i < 3; i++) body->area[at[i]] += area;
        }
    }
}

/* ---- matrix ---- */

/* The number of a block; all have nine values. */
static int dgfem_mvci_block_index(const dgfem_matrix *matrix, int row, int column) {
    return (int)((dgfem_matrix_block(matrix, row, column) - matrix->values) / 9);
}

/* Enters the block of each pair in places. Or counts the parts of each block in part_start[block + 1]; or, once these
   are beginnings, writes them there, and part_start[block + 1] moves on. */
static void dgfem_mvci_enter_parts(const dgfem_mvc *body, dgfem_mvc_system *system, int is_write) {
    int pair = 0;
    for (int e = 0; e < body->element_count; e++) {
        const int *nodes = system->nodes + system->node_start[e];
        int count = system->node_start[e + 1] - system->node_start[e];
        for (int a = 0; a < count; a++)
            for (int b = 0; b <= a; b++, pair++) {
                int turned = nodes[a] < nodes[b];
                int block = dgfem_mvci_block_index(system->matrix, nodes[turned ? b : a], nodes[turned ? a : b]);
                if (system->places) {
                    system->places[pair] = block;
                    continue;
                }
                int at = system->part_start[block + 1]++;
                if (!is_write) continue;
                system->parts[at].element = e;
                system->parts[at].pair = pair;
                system->parts[at].turned = turned;
            }
    }
}

static void dgfem_mvci_list_parts(const dgfem_mvc *body, dgfem_mvc_system *system, int blocks) {
    int *start = system->part_start, sum = 0;
    dgfem_mvci_enter_parts(body, system, 0);
    for (int k = 0; k < blocks; k++) { /* from counts to beginnings */
        int count = start[k + 1];
        start[k + 1] = sum;
        sum += count;
    }
    dgfem_mvci_enter_parts(body, system, 1);
}

/* places or parts, as the hooks ask, and diagonal. 0 when out of memory. */
static int dgfem_mvci_list_blocks(const dgfem_mvc *body, dgfem_mvc_system *system) {
    const dgfem_hooks *hooks = &body->hooks;
    const dgfem_matrix *matrix = system->matrix;
    size_t pairs = system->pair_start[body->element_count];
    int blocks = matrix->row_start[matrix->block_count];
    DGFEM_ASSERT(matrix->value_start[blocks] == 9 * (size_t)blocks);
    for (int i = 0; i < body->node_count; i++) system->diagonal[i] = 9 * (size_t)dgfem_mvci_block_index(matrix, i, i);
    if (!hooks->parallel_for) {
        system->places = (int *)dgfem_mvci_allocate(hooks, pairs, sizeof(int));
        if (system->places) dgfem_mvci_enter_parts(body, system, 0);
        return system->places != NULL;
    }
    system->part_start = (int *)dgfem_mvci_allocate(hooks, (size_t)blocks + 1, sizeof(int));
    system->parts = (dgfem_mvci_block_part *)dgfem_mvci_allocate(hooks, pairs, sizeof *system->parts);
    if (!system->part_start || !system->parts) return 0;
    dgfem_mvci_list_parts(body, system, blocks);
    return 1;
}

static dgfem_status dgfem_mvci_create_matrix(const dgfem_mvc *body, dgfem_mvc_system *system) {
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(&body->hooks);
    dgfem_matrix_desc desc = dgfem_default_matrix_desc();
    size_t pairs = system->pair_start[body->element_count];
    if (pairs > (size_t)INT_MAX / 2)
        return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "%d elements are too many", body->element_count);
    int *sizes = (int *)dgfem_mvci_take(&scratch, (size_t)body->node_count, sizeof(int));
    int *list = (int *)dgfem_mvci_take(&scratch, 2 * pairs, sizeof(int)), *at = list;
    dgfem_status status = DGFEM_ERROR_MEMORY;
    if (sizes && list) {
        for (int i = 0; i < body->node_count; i++) sizes[i] = 3;
        for (int e = 0; e < body->element_count; e++)
            for (int a = system->node_start[e]; a < system->node_start[e + 1]; a++)
                for (int b = system->node_start[e]; b <= a; b++) *at++ = system->nodes[a], *at++ = system->nodes[b];
        desc.block_count = body->node_count;
        desc.block_sizes = sizes;
        desc.pairs = list;
        desc.pair_count = (int)pairs;
        desc.centres = body->mesh->rest;
        desc.hooks = body->hooks;
        desc.hooks.log = NULL; /* the body has its own line */
        status = dgfem_matrix_create(&desc, &system->matrix);
    }
    dgfem_mvci_scratch_free(&scratch);
    return status ? dgfem_mvci_fail(&body->hooks, status, "the matrix of %d nodes", body->node_count) : DGFEM_OK;
}

/* Where factorizations are dear, a good order of elimination pays with the first of them. Otherwise a fair one that
   costs a tenth of it to find does as well: a body that is being cut is analysed often. */
static dgfem_ordering dgfem_mvci_choose_ordering(const dgfem_mvc *body, int is_cut) {
    const double dear = 2e9, per_node = 80; /* as measured in tetrahedra and their parts */
    double flops = body->system->factor_flops, nodes = (double)body->node_count;
    if (!(flops > 0)) flops = per_node * nodes * nodes;
    return is_cut && flops < dear ? DGFEM_ORDERING_MINIMUM_DEGREE : DGFEM_ORDERING_AUTO;
}

static void dgfem_mvci_free_solver(const dgfem_hooks *hooks, dgfem_mvc_system *system) {
    dgfem_mvci_free(hooks, system->part_start);
    dgfem_mvci_free(hooks, system->parts);
    dgfem_mvci_free(hooks, system->places);
    dgfem_mvci_free(hooks, system->diagonal);
    dgfem_mvci_free(hooks, system->pcg_work);
    dgfem_matrix_destroy(system->matrix);
    dgfem_cholesky_destroy(system->cholesky);
    system->part_start = NULL;
    system->parts = NULL;
    system->places = NULL;
    system->diagonal = NULL;
    system->pcg_work = NULL;
    system->matrix = NULL;
    system->cholesky = NULL;
}

static dgfem_status dgfem_mvci_create_solver(const dgfem_mvc *body, dgfem_mvc_system *system, int is_cut) {
    const dgfem_hooks *hooks = &body->hooks;
    dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
    dgfem_status status = dgfem_mvci_create_matrix(body, system);
    if (status) return status;
    desc.ordering = dgfem_mvci_choose_ordering(body, is_cut);
    desc.hooks = *hooks;
    desc.hooks.log = NULL;
    if (body->desc.solver == DGFEM_SOLVER_CHOLESKY)
        status = dgfem_cholesky_create(system->matrix, &desc, &system->cholesky);
    else
        system->pcg_work =
            (dgfem_real *)dgfem_mvci_allocate(hooks, dgfem_pcg_work_size(system->matrix), sizeof(dgfem_real));
    if (status) return dgfem_mvci_fail(hooks, status, "the solver of %d nodes", body->node_count);
    system->diagonal = (size_t *)dgfem_mvci_allocate(hooks, (size_t)body->node_count, sizeof(size_t));
    if (!system->diagonal || (!system->cholesky && !system->pcg_work) || !dgfem_mvci_list_blocks(body, system))
        return dgfem_mvci_fail_memory(hooks);
    return DGFEM_OK;
}

/* The matrix and its solver, where they are not there yet: cuts leave them to the next step or solve, so that several
   in a row make them once. On failure nothing has changed. */
static dgfem_status dgfem_mvci_prepare_solver(dgfem_mvc *body, int is_cut) {
    if (body->system->matrix) return DGFEM_OK;
    dgfem_status status = dgfem_mvci_create_solver(body, body->system, is_cut);
    if (status) dgfem_mvci_free_solver(&body->hooks, body->system);
    return status;
}

/* ---- topology: all that is made anew when the mesh changes ---- */

static void dgfem_mvci_system_destroy(const dgfem_hooks *hooks, dgfem_mvc_system *system) {
    if (!system) return;
    dgfem_mvci_free(hooks, system->node_start);
    dgfem_mvci_free(hooks, system->nodes);
    dgfem_mvci_free(hooks, system->share);
    dgfem_mvci_free(hooks, system->mean);
    dgfem_mvci_free(hooks, system->pair_start);
    dgfem_mvci_free(hooks, system->stiffness);
    dgfem_mvci_free_solver(hooks, system);
    dgfem_mvci_free(hooks, system->held);
    dgfem_mvci_free(hooks, system->next);
    dgfem_mvci_free(hooks, system->work);
    dgfem_mvci_free(hooks, system->local);
    dgfem_mvci_free(hooks, system->use_start);
    dgfem_mvci_free(hooks, system->uses);
    dgfem_mvci_free(hooks, system);
}

/* Everything by node, element and pair, but not the mesh itself. */
static void dgfem_mvci_free_topology(dgfem_mvc *body) {
    const dgfem_hooks *hooks = &body->hooks;
    dgfem_mvci_free(hooks, body->mass);
    dgfem_mvci_free(hooks, body->area);
    dgfem_mvci_free(hooks, body->modulus);
    dgfem_mvci_free(hooks, body->material);
    dgfem_mvci_free(hooks, body->tag);
    dgfem_mvci_free(hooks, body->volume);
    dgfem_mvci_free(hooks, body->centre);
    dgfem_mvci_free(hooks, body->rotation);
    dgfem_mvci_system_destroy(hooks, body->system);
}

static int dgfem_mvci_allocate_topology(dgfem_mvc *body) {
    const dgfem_hooks *hooks = &body->hooks;
    size_t nodes = (size_t)body->node_count, elements = (size_t)body->element_count;
    dgfem_mvc_system *system = (dgfem_mvc_system *)dgfem_mvci_allocate(hooks, 1, sizeof *system);
    body->system = system;
    body->mass = (dgfem_real *)dgfem_mvci_allocate(hooks, nodes, sizeof(dgfem_real));
    body->area = (dgfem_real *)dgfem_mvci_allocate(hooks, nodes, sizeof(dgfem_real));
    body->modulus = (dgfem_real *)dgfem_mvci_allocate(hooks, nodes, sizeof(dgfem_real));
    body->material = (dgfem_material *)dgfem_mvci_allocate(hooks, elements, sizeof(dgfem_material));
    body->tag = (int *)dgfem_mvci_allocate(hooks, elements, sizeof(int));
    body->volume = (dgfem_real *)dgfem_mvci_allocate(hooks, elements, sizeof(dgfem_real));
    body->centre = (dgfem_vec3 *)dgfem_mvci_allocate(hooks, elements, sizeof(dgfem_vec3));
    body->rotation = (dgfem_mat3 *)dgfem_mvci_allocate(hooks, elements, sizeof(dgfem_mat3));
    if (!system || !body->mass || !body->area || !body->modulus || !body->material || !body->tag || !body->volume ||
        !body->centre || !body->rotation)
        return 0;
    system->held = (char *)dgfem_mvci_allocate(hooks, nodes, 1);
    system->next = (dgfem_mat3 *)dgfem_mvci_allocate(hooks, elements, sizeof(dgfem_mat3));
    system->work = (dgfem_vec3 *)dgfem_mvci_allocate(hooks, DGFEM_MVCI_VECTORS * nodes, sizeof(dgfem_vec3));
    return system->held && system->next && system->work;
}

/* Points the body at the state that the mesh holds. */
static void dgfem_mvci_adopt_mesh(dgfem_mvc *body, dgfem_mvci_mesh *mesh) {
    body->mesh = mesh;
    body->node_count = mesh->node_count;
    body->face_count = mesh->face_count;
    body->element_count = mesh->element_count;
    body->rest = mesh->rest;
    body->position = mesh->position;
    body->velocity = mesh->velocity;
}

/* Makes everything that follows from body->mesh, but for the matrix and its solver; body->material is filled in from
   desc.materials or from what the elements were in `before`. On failure the caller frees the topology. */
static dgfem_status dgfem_mvci_build_topology(dgfem_mvc *body, const dgfem_mesh *source, const dgfem_mvc *before) {
    size_t points;
    int corners;
    if (!dgfem_mvci_allocate_topology(body)) return dgfem_mvci_fail_memory(&body->hooks);
    for (int e = 0; e < body->element_count; e++) {
        int from = body->mesh->elements[e].from;
        body->material[e] = before                 ? before->material[from]
                            : body->desc.materials ? body->desc.materials[from]
                                                   : body->desc.material;
        body->tag[e] = before ? before->tag[from] : source->elements[from].tag;
        body->rotation[e] = before ? before->rotation[from] : dgfem_mvci_identity();
    }
    if (!dgfem_mvci_lay_out(body, body->system, &points, &corners)) return dgfem_mvci_fail_memory(&body->hooks);
    dgfem_status status = dgfem_mvci_integrate(body, body->system, before, points, corners);
    if (status) return status;
    dgfem_mvci_measure_nodes(body, body->system);
    if (before) body->system->factor_flops = before->system->factor_flops;
    return DGFEM_OK;
}
