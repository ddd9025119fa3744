#pragma once
#include "basis.c"
#include "corners.c"
#include "locate.c"
/* Embedding of points in a body by moving least squares (MLS), eq. (30)-(32).

   Samples are the centres of the elements and a thinned set of the stitched corners. A point's displacement is the
   value at x of the affine function that fits the samples' displacements best in the sense of
     sum_k theta_k |a(x_k) - u_k|^2,   theta = exp(-2 q^2) (1 - q^2)^3,   q = |x - x_k| / R_k < 1,
   a window that is C2 at its edge. In terms of weighted means (W = sum theta_k, m = sum theta_k x_k / W,
   C = sum theta_k (x_k - m)(x_k - m)^T) the weight of sample k is
     phi_k(x) = theta_k (1/W + (x_k - m)^T C^-1 (x - m)),   sum phi_k = 1,   sum phi_k x_k = x.

   A sample reaches a point only through glued elements. Where the straight way is blocked (between two ears, across a
   cut) the distance to the elements that have to be passed counts instead, so that weights vanish continuously:

        .-----.     .-----.          x: the point, s: a sample in the other arm
        |  x  |     |  s  |          path: down through the bridge B and up again
        |     '-----'     |          q = max(|x - s|, distance(x, B)) / R_s
        |        B        |
        '-----------------'  */

/* ---- samples: element centres and thinned corners ---- */

#define DGFEM_THINNING DGFEM_R(0.3) /* of the mean radius: a corner that near to a kept sample of its elements may go */
#define DGFEM_MIN_ELEMENT_SAMPLES 5 /* each element keeps at least so many samples, its centre included */
#define DGFEM_SPREAD DGFEM_R(0.05)  /* and at least this part of the smallest principal moment of all its corners */

typedef struct dgfemi_thinning {
    const dgfem_mesh *mesh;
    const dgfem_corners *corners;
    int *kept;        /* [corners] */
    int *corner_of;   /* [incidences]: corner of each entry of corners->elements */
    int *head, *next; /* the kept corners of each element, chained through the incidences */
} dgfemi_thinning;

static dgfem_vec3 dgfemi_corner_position(const dgfemi_thinning *thinning, int corner) {
    return thinning->mesh->vertices[thinning->corners->vertex[corner]];
}

static dgfem_real dgfemi_mean_radius(const dgfem_mesh *mesh, const int *elements, int count) {
    dgfem_real sum = 0;
    for (int i = 0; i < count; i++) sum += mesh->elements[elements[i]].radius;
    return sum / (dgfem_real)count;
}

static void dgfemi_thinning_keep(dgfemi_thinning *thinning, int corner) {
    thinning->kept[corner] = 1;
    for (int i = thinning->corners->element_start[corner]; i < thinning->corners->element_start[corner + 1]; i++) {
        int element = thinning->corners->elements[i];
        thinning->next[i] = thinning->head[element];
        thinning->head[element] = i;
    }
}

/* Distance from x to the nearest kept sample of the element. */
static dgfem_real dgfemi_thinning_distance(const dgfemi_thinning *thinning, int element, dgfem_vec3 x) {
    dgfem_real distance = dgfemi_distance(x, thinning->mesh->elements[element].centre);
    for (int i = thinning->head[element]; i != DGFEM_NONE; i = thinning->next[i])
        distance = dgfemi_min(distance, dgfemi_distance(x, dgfemi_corner_position(thinning, thinning->corner_of[i])));
    return distance;
}

static int dgfemi_thinning_is_redundant(const dgfemi_thinning *thinning, int corner) {
    const dgfem_corners *corners = thinning->corners;
    int first = corners->element_start[corner], last = corners->element_start[corner + 1];
    dgfem_real limit = DGFEM_THINNING * dgfemi_mean_radius(thinning->mesh, corners->elements + first, last - first);
    dgfem_vec3 x = dgfemi_corner_position(thinning, corner);
    for (int i = first; i < last; i++)
        if (dgfemi_thinning_distance(thinning, corners->elements[i], x) < limit) return 1;
    return 0;
}

static dgfem_real dgfemi_smallest_moment(const dgfem_mat3 *scatter, int count) {
    dgfem_real values[3];
    dgfem_mat3 axes;
    dgfem_eigen_symmetric(*scatter, values, &axes);
    return values[0] / (dgfem_real)count;
}

/* Whether the kept samples of the element are enough, and as far from coplanar as the element's corners allow. */
static int dgfemi_thinning_suffices(const dgfemi_thinning *thinning, int element) {
    const dgfem_corners *corners = thinning->corners;
    dgfem_vec3 centre = thinning->mesh->elements[element].centre;
    dgfem_mat3 kept, all;
    int kept_count = 1, all_count = 1; /* the centre */
    memset(&kept, 0, sizeof kept);
    memset(&all, 0, sizeof all);
    for (int i = corners->corner_start[element]; i < corners->corner_start[element + 1]; i++) {
        dgfem_vec3 d = dgfemi_sub(dgfemi_corner_position(thinning, corners->corners[i]), centre);
        dgfemi_add_outer(&all, 1, d, d);
        all_count++;
        if (!thinning->kept[corners->corners[i]]) continue;
        dgfemi_add_outer(&kept, 1, d, d);
        kept_count++;
    }
    return kept_count == all_count ||
           (kept_count >= DGFEM_MIN_ELEMENT_SAMPLES &&
            dgfemi_smallest_moment(&kept, kept_count) >= DGFEM_SPREAD * dgfemi_smallest_moment(&all, all_count));
}

/* Keeps the corner of the element that is farthest from all its kept samples. */
static void dgfemi_thinning_keep_farthest(dgfemi_thinning *thinning, int element) {
    const dgfem_corners *corners = thinning->corners;
    dgfem_real largest = -1;
    int farthest = DGFEM_NONE;
    for (int i = corners->corner_start[element]; i < corners->corner_start[element + 1]; i++) {
        int corner = corners->corners[i];
        dgfem_real distance;
        if (thinning->kept[corner]) continue;
        distance = dgfemi_thinning_distance(thinning, element, dgfemi_corner_position(thinning, corner));
        if (distance > largest) largest = distance, farthest = corner;
    }
    DGFEM_ASSERT(farthest != DGFEM_NONE);
    dgfemi_thinning_keep(thinning, farthest);
}

/* Corners by number of incident elements, descending, then by index (counting sort). 1 on success. */
static int dgfemi_thinning_order(dgfemi_arena *arena, const dgfem_corners *corners, int *order) {
    int most = 0, position = 0;
    int *start;
    for (int c = 0; c < corners->count; c++) {
        int count = corners->element_start[c + 1] - corners->element_start[c];
        if (count > most) most = count;
    }
    start = (int *)dgfemi_arena_allocate_zero(arena, (size_t)most + 1, sizeof(int));
    if (!start) return 0;
    for (int c = 0; c < corners->count; c++) start[corners->element_start[c + 1] - corners->element_start[c]]++;
    for (int n = most; n >= 0; n--) {
        int count = start[n];
        start[n] = position;
        position += count;
    }
    for (int c = 0; c < corners->count; c++)
        order[start[corners->element_start[c + 1] - corners->element_start[c]]++] = c;
    return 1;
}

/* Which corners become samples. 1 on success, 0 when out of memory. */
static int dgfemi_thin_corners(dgfemi_arena *arena, const dgfem_mesh *mesh, const dgfem_corners *corners, int **kept) {
    size_t incidences = (size_t)corners->element_start[corners->count];
    dgfemi_thinning thinning;
    int *order = (int *)dgfemi_arena_allocate(arena, (size_t)corners->count, sizeof(int));
    thinning.mesh = mesh, thinning.corners = corners;
    thinning.kept = (int *)dgfemi_arena_allocate_zero(arena, (size_t)corners->count, sizeof(int));
    thinning.corner_of = (int *)dgfemi_arena_allocate(arena, incidences, sizeof(int));
    thinning.next = (int *)dgfemi_arena_allocate(arena, incidences, sizeof(int));
    thinning.head = (int *)dgfemi_arena_allocate(arena, (size_t)mesh->element_count, sizeof(int));
    if (!order || !thinning.kept || !thinning.corner_of || !thinning.next || !thinning.head) return 0;
    if (!dgfemi_thinning_order(arena, corners, order)) return 0;
    for (int e = 0; e < mesh->element_count; e++) thinning.head[e] = DGFEM_NONE;
    for (int c = 0; c < corners->count; c++)
        for (int i = corners->element_start[c]; i < corners->element_start[c + 1]; i++) thinning.corner_of[i] = c;
    for (int i = 0; i < corners->count; i++)
        if (!dgfemi_thinning_is_redundant(&thinning, order[i])) dgfemi_thinning_keep(&thinning, order[i]);
    for (int e = 0; e < mesh->element_count; e++)
        while (!dgfemi_thinning_suffices(&thinning, e)) dgfemi_thinning_keep_farthest(&thinning, e);
    *kept = thinning.kept;
    return 1;
}

/* Sets samples and terms: sample k, at positions[k], averages the polynomials of elements[start[k] .. start[k + 1]). */
static int dgfemi_embedding_set_samples(dgfem_embedding *embedding, const dgfem_body *body, const dgfem_vec3 *positions,
                                        const int *start, const int *elements, int count) {
    const dgfem_hooks *hooks = &embedding->hooks;
    int terms = start[count], basis = 0;
    embedding->sample_count = count;
    embedding->samples = (dgfem_vec3 *)dgfemi_duplicate(hooks, positions, (size_t)count, sizeof(dgfem_vec3));
    embedding->term_start = (int *)dgfemi_duplicate(hooks, start, (size_t)count + 1, sizeof(int));
    embedding->term_element = (int *)dgfemi_duplicate(hooks, elements, (size_t)terms, sizeof(int));
    embedding->term_basis_start = (int *)dgfemi_allocate(hooks, (size_t)terms + 1, sizeof(int));
    if (!embedding->samples || !embedding->term_start || !embedding->term_element || !embedding->term_basis_start)
        return 0;
    for (int t = 0; t < terms; t++) {
        embedding->term_basis_start[t] = basis;
        basis += dgfem_monomial_count(body->degree[elements[t]]);
    }
    embedding->term_basis_start[terms] = basis;
    embedding->term_basis = (dgfem_real *)dgfemi_allocate(hooks, (size_t)basis, sizeof(dgfem_real));
    if (!embedding->term_basis) return 0;
    for (int k = 0; k < count; k++)
        for (int t = start[k]; t < start[k + 1]; t++) {
            int e = elements[t];
            dgfemi_basis_evaluate(body->degree[e], body->origin[e], body->scale[e], positions[k],
                                  embedding->term_basis + embedding->term_basis_start[t]);
        }
    return 1;
}

/* Samples of an embedding: first the centre of each element, then the kept corners. 1 on success. */
static int dgfemi_embedding_choose_samples(dgfemi_arena *arena, dgfem_embedding *embedding, const dgfem_body *body,
                                           const dgfem_corners *corners) {
    const dgfem_mesh *mesh = body->mesh;
    int count = mesh->element_count, terms = mesh->element_count;
    dgfem_vec3 *positions;
    int *start, *elements, *kept;
    if (!dgfemi_thin_corners(arena, mesh, corners, &kept)) return 0;
    for (int c = 0; c < corners->count; c++)
        if (kept[c]) count++, terms += corners->element_start[c + 1] - corners->element_start[c];
    positions = (dgfem_vec3 *)dgfemi_arena_allocate(arena, (size_t)count, sizeof(dgfem_vec3));
    start = (int *)dgfemi_arena_allocate(arena, (size_t)count + 1, sizeof(int));
    elements = (int *)dgfemi_arena_allocate(arena, (size_t)terms, sizeof(int));
    if (!positions || !start || !elements) return 0;
    for (int e = 0; e < mesh->element_count; e++) positions[e] = mesh->elements[e].centre, start[e] = elements[e] = e;
    count = terms = mesh->element_count;
    for (int c = 0; c < corners->count; c++) {
        if (!kept[c]) continue;
        positions[count] = mesh->vertices[corners->vertex[c]];
        start[count++] = terms;
        for (int i = corners->element_start[c]; i < corners->element_start[c + 1]; i++)
            elements[terms++] = corners->elements[i];
    }
    start[count] = terms;
    return dgfemi_embedding_set_samples(embedding, body, positions, start, elements, count);
}

/* ---- reach: how far samples see, and through which elements ---- */

#define DGFEM_WINDOW DGFEM_R(2.309401076758503) /* R_k / mean radius: two edges of a cube */
#define DGFEM_ENLARGE DGFEM_R(1.25)
#define DGFEM_MIN_POINT_SAMPLES 8
#define DGFEM_MAX_CONDITION DGFEM_R(1e4) /* of C; a larger one enlarges the windows */
#define DGFEM_CONDITION_ROUNDS 4         /* but only so often: a thin plate has no better one to offer */
#define DGFEM_MAX_ROUNDS 64
#define DGFEM_OUTSIDE DGFEM_R(0.5) /* of the radius: windows are not evaluated farther outside an element */

typedef struct dgfemi_sampling {
    const dgfem_mesh *mesh;
    const dgfem_embedding *embedding; /* its samples and terms are set */
    const dgfemi_locator *locator;
    int *element_start, *element_sample; /* samples of each element, ascending */
    int *neighbour_start, *neighbour;    /* glued neighbours of each element */
    dgfem_real *radius;                  /* [samples] R_k */
    dgfem_real *reach;                   /* [elements] largest R_k of the samples that may see through the element */
    int *component;                      /* [elements] glued component */
    int *component_samples;              /* [components] number of samples */
    int *mark, stamp;                    /* [elements] flood that met the element last */
    int *stack;                          /* [elements] */
} dgfemi_sampling;

static dgfem_real dgfemi_sampling_distance(const dgfemi_sampling *sampling, int element, dgfem_vec3 x) {
    return dgfemi_box_distance(sampling->locator->lower[element], sampling->locator->upper[element], x);
}

static void dgfemi_sampling_components(dgfemi_sampling *sampling) {
    const dgfem_mesh *mesh = sampling->mesh;
    int components = 0;
    for (int e = 0; e < mesh->element_count; e++) sampling->component[e] = DGFEM_NONE;
    for (int seed = 0; seed < mesh->element_count; seed++) {
        int depth = 0;
        if (sampling->component[seed] != DGFEM_NONE) continue;
        sampling->component[seed] = components;
        sampling->stack[depth++] = seed;
        while (depth > 0) {
            int e = sampling->stack[--depth];
            for (int k = sampling->neighbour_start[e]; k < sampling->neighbour_start[e + 1]; k++) {
                int neighbour = sampling->neighbour[k];
                if (sampling->component[neighbour] != DGFEM_NONE) continue;
                sampling->component[neighbour] = components;
                sampling->stack[depth++] = neighbour;
            }
        }
        components++;
    }
    for (int i = 0; i < components; i++) sampling->component_samples[i] = 0;
    for (int s = 0; s < sampling->embedding->sample_count; s++) {
        int element = sampling->embedding->term_element[sampling->embedding->term_start[s]];
        sampling->component_samples[sampling->component[element]]++;
    }
}

/* Lists the samples of each element from the elements of each sample; `fill` is zero. */
static void dgfemi_sampling_incidence(dgfemi_sampling *sampling, int *fill) {
    const dgfem_embedding *embedding = sampling->embedding;
    int total = 0;
    for (int t = 0; t < embedding->term_start[embedding->sample_count]; t++) fill[embedding->term_element[t]]++;
    for (int e = 0; e < sampling->mesh->element_count; e++) {
        int count = fill[e];
        sampling->element_start[e] = fill[e] = total;
        total += count;
    }
    sampling->element_start[sampling->mesh->element_count] = total;
    for (int s = 0; s < embedding->sample_count; s++)
        for (int t = embedding->term_start[s]; t < embedding->term_start[s + 1]; t++)
            sampling->element_sample[fill[embedding->term_element[t]]++] = s;
}

/* Lists the glued neighbours of each element: none at the boundary and behind a cut. `fill` is zero. */
static void dgfemi_sampling_neighbours(dgfemi_sampling *sampling, int *fill) {
    const dgfem_mesh *mesh = sampling->mesh;
    int total = 0;
    for (int pass = 0; pass < 2; pass++) {
        for (int f = 0; f < mesh->face_count; f++) {
            int a = mesh->faces[f].element[0], b = mesh->faces[f].element[1];
            if (b == DGFEM_NONE || mesh->faces[f].cut) continue;
            if (pass == 1) sampling->neighbour[fill[a]] = b, sampling->neighbour[fill[b]] = a;
            fill[a]++, fill[b]++;
        }
        for (int e = 0; pass == 0 && e < mesh->element_count; e++) {
            int count = fill[e];
            sampling->neighbour_start[e] = fill[e] = total;
            total += count;
        }
    }
    sampling->neighbour_start[mesh->element_count] = total;
}

/* Marks with a sample's radius every element that the sample may see through: connected to it within that radius. */
static void dgfemi_sampling_flood(dgfemi_sampling *sampling, int sample) {
    const dgfem_embedding *embedding = sampling->embedding;
    dgfem_real radius = sampling->radius[sample];
    int depth = 0;
    sampling->stamp++;
    for (int t = embedding->term_start[sample]; t < embedding->term_start[sample + 1]; t++) {
        sampling->mark[embedding->term_element[t]] = sampling->stamp;
        sampling->stack[depth++] = embedding->term_element[t];
    }
    while (depth > 0) {
        int e = sampling->stack[--depth];
        sampling->reach[e] = dgfemi_max(sampling->reach[e], radius);
        for (int k = sampling->neighbour_start[e]; k < sampling->neighbour_start[e + 1]; k++) {
            int neighbour = sampling->neighbour[k];
            if (sampling->mark[neighbour] == sampling->stamp) continue;
            if (!(dgfemi_sampling_distance(sampling, neighbour, embedding->samples[sample]) < radius)) continue;
            sampling->mark[neighbour] = sampling->stamp;
            sampling->stack[depth++] = neighbour;
        }
    }
}

static void dgfemi_sampling_update_reach(dgfemi_sampling *sampling) {
    for (int e = 0; e < sampling->mesh->element_count; e++) sampling->reach[e] = 0;
    for (int s = 0; s < sampling->embedding->sample_count; s++) dgfemi_sampling_flood(sampling, s);
}

/* 1 on success, 0 when out of memory. */
static int dgfemi_sampling_make(dgfemi_arena *arena, const dgfem_mesh *mesh, const dgfem_embedding *embedding,
                                const dgfemi_locator *locator, dgfemi_sampling *sampling) {
    size_t elements = (size_t)mesh->element_count, terms = (size_t)embedding->term_start[embedding->sample_count];
    int *fill = (int *)dgfemi_arena_allocate_zero(arena, 2 * elements, sizeof(int));
    memset(sampling, 0, sizeof *sampling);
    sampling->mesh = mesh, sampling->embedding = embedding, sampling->locator = locator;
    sampling->element_start = (int *)dgfemi_arena_allocate(arena, elements + 1, sizeof(int));
    sampling->element_sample = (int *)dgfemi_arena_allocate(arena, terms, sizeof(int));
    sampling->neighbour_start = (int *)dgfemi_arena_allocate(arena, elements + 1, sizeof(int));
    sampling->neighbour = (int *)dgfemi_arena_allocate(arena, 2 * (size_t)mesh->face_count, sizeof(int));
    sampling->radius = (dgfem_real *)dgfemi_arena_allocate(arena, (size_t)embedding->sample_count, sizeof(dgfem_real));
    sampling->reach = (dgfem_real *)dgfemi_arena_allocate(arena, elements, sizeof(dgfem_real));
    sampling->component = (int *)dgfemi_arena_allocate(arena, elements, sizeof(int));
    sampling->component_samples = (int *)dgfemi_arena_allocate(arena, elements, sizeof(int));
    sampling->mark = (int *)dgfemi_arena_allocate_zero(arena, elements, sizeof(int));
    sampling->stack = (int *)dgfemi_arena_allocate(arena, elements, sizeof(int));
    if (!fill || !sampling->element_start || !sampling->element_sample || !sampling->neighbour_start ||
        !sampling->neighbour || !sampling->radius || !sampling->reach || !sampling->component ||
        !sampling->component_samples || !sampling->mark || !sampling->stack)
        return 0;
    dgfemi_sampling_incidence(sampling, fill);
    dgfemi_sampling_neighbours(sampling, fill + mesh->element_count);
    dgfemi_sampling_components(sampling);
    for (int s = 0; s < embedding->sample_count; s++) {
        int first = embedding->term_start[s], count = embedding->term_start[s + 1] - first;
        sampling->radius[s] = DGFEM_WINDOW * dgfemi_mean_radius(mesh, embedding->term_element + first, count);
    }
    dgfemi_sampling_update_reach(sampling);
    return 1;
}

/* ---- query: the samples that reach a point ---- */

typedef struct dgfemi_query {
    dgfemi_sampling *sampling;
    int *element_mark, *sample_mark, stamp; /* query that met the element, the sample last */
    dgfem_real *way; /* [elements] distance of the farthest element that must be passed to get there, itself included */
    int *heap;       /* [elements] elements to visit, the one with the shortest way on top */
    int heap_count;
    int *visited; /* [elements] in the order of their ways */
    int visited_count;
    int *sample;        /* [samples] that reach the point */
    dgfem_real *theta;  /* [samples] their windows */
    dgfem_real *weight; /* [samples] their weights */
    int count;
} dgfemi_query;

static int dgfemi_query_make(dgfemi_arena *arena, dgfemi_sampling *sampling, dgfemi_query *query) {
    size_t elements = (size_t)sampling->mesh->element_count, samples = (size_t)sampling->embedding->sample_count;
    memset(query, 0, sizeof *query);
    query->sampling = sampling;
    query->element_mark = (int *)dgfemi_arena_allocate_zero(arena, elements, sizeof(int));
    query->sample_mark = (int *)dgfemi_arena_allocate_zero(arena, samples, sizeof(int));
    query->way = (dgfem_real *)dgfemi_arena_allocate(arena, elements, sizeof(dgfem_real));
    query->heap = (int *)dgfemi_arena_allocate(arena, elements, sizeof(int));
    query->visited = (int *)dgfemi_arena_allocate(arena, elements, sizeof(int));
    query->sample = (int *)dgfemi_arena_allocate(arena, samples, sizeof(int));
    query->theta = (dgfem_real *)dgfemi_arena_allocate(arena, samples, sizeof(dgfem_real));
    query->weight = (dgfem_real *)dgfemi_arena_allocate(arena, samples, sizeof(dgfem_real));
    return query->element_mark && query->sample_mark && query->way && query->heap && query->visited && query->sample &&
           query->theta && query->weight;
}

/* Shorter way first, then lower index: one order, whatever the history of the heap. */
static int dgfemi_query_before(const dgfemi_query *query, int a, int b) {
    if (query->way[a] < query->way[b]) return 1;
    return !(query->way[b] < query->way[a]) && a < b;
}

static void dgfemi_query_push(dgfemi_query *query, int element, dgfem_real way) {
    int i = query->heap_count++;
    query->element_mark[element] = query->stamp;
    query->way[element] = way;
    while (i > 0 && dgfemi_query_before(query, element, query->heap[(i - 1) / 2])) {
        query->heap[i] = query->heap[(i - 1) / 2];
        i = (i - 1) / 2;
    }
    query->heap[i] = element;
}

static int dgfemi_query_pop(dgfemi_query *query) {
    int top = query->heap[0], last = query->heap[--query->heap_count], i = 0;
    for (;;) {
        int child = 2 * i + 1;
        if (child >= query->heap_count) break;
        if (child + 1 < query->heap_count && dgfemi_query_before(query, query->heap[child + 1], query->heap[child]))
            child++;
        if (!dgfemi_query_before(query, query->heap[child], last)) break;
        query->heap[i] = query->heap[child];
        i = child;
    }
    query->heap[i] = last;
    return top;
}

static dgfem_real dgfemi_window(dgfem_real q) {
    dgfem_real square = q * q, rest = 1 - square;
    return (dgfem_real)exp(-2 * (double)square) * rest * rest * rest;
}

/* Accepts the samples of an element just visited. The first visit of a sample comes by its shortest way. */
static void dgfemi_query_accept(dgfemi_query *query, int element, dgfem_vec3 x) {
    const dgfemi_sampling *sampling = query->sampling;
    for (int i = sampling->element_start[element]; i < sampling->element_start[element + 1]; i++) {
        int s = sampling->element_sample[i];
        dgfem_real distance;
        if (query->sample_mark[s] == query->stamp) continue;
        query->sample_mark[s] = query->stamp;
        distance = dgfemi_max(query->way[element], dgfemi_distance(sampling->embedding->samples[s], x));
        if (!(distance < sampling->radius[s])) continue;
        query->theta[query->count] = dgfemi_window(distance / sampling->radius[s]);
        query->sample[query->count++] = s;
    }
}

/* Finds the samples that reach x from the element `home`: elements are visited in the order of their ways, the way of a
   neighbour being max(way, distance from x to the neighbour's box). */
static void dgfemi_query_run(dgfemi_query *query, int home, dgfem_vec3 x) {
    const dgfemi_sampling *sampling = query->sampling;
    query->stamp++;
    query->count = query->heap_count = query->visited_count = 0;
    dgfemi_query_push(query, home, 0);
    while (query->heap_count > 0) {
        int e = dgfemi_query_pop(query);
        query->visited[query->visited_count++] = e;
        dgfemi_query_accept(query, e, x);
        for (int k = sampling->neighbour_start[e]; k < sampling->neighbour_start[e + 1]; k++) {
            int neighbour = sampling->neighbour[k];
            dgfem_real way;
            if (query->element_mark[neighbour] == query->stamp) continue;
            way = dgfemi_max(query->way[e], dgfemi_sampling_distance(sampling, neighbour, x));
            if (way < sampling->reach[neighbour]) dgfemi_query_push(query, neighbour, way);
        }
    }
}

/* ---- weights ---- */

/* Weighted means of the samples that reach x, relative to x. */
typedef struct dgfemi_fit {
    dgfem_real weight;    /* W */
    dgfem_vec3 mean;      /* m - x */
    dgfem_real moment[3]; /* eigenvalues of C, ascending, */
    dgfem_mat3 axes;      /* and its eigenvectors */
} dgfemi_fit;

#define DGFEM_FLAT                                                                                                     \
    (DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-6) : DGFEM_R(1e-12)) /* of the largest moment: smaller is round-off */

static dgfem_vec3 dgfemi_query_offset(const dgfemi_query *query, int i, dgfem_vec3 x) {
    return dgfemi_sub(query->sampling->embedding->samples[query->sample[i]], x);
}

static void dgfemi_query_fit(const dgfemi_query *query, dgfem_vec3 x, dgfemi_fit *fit) {
    dgfem_mat3 c;
    memset(fit, 0, sizeof *fit);
    for (int i = 0; i < query->count; i++) {
        fit->weight += query->theta[i];
        fit->mean = dgfemi_add_scaled(fit->mean, query->theta[i], dgfemi_query_offset(query, i, x));
    }
    if (!(fit->weight > 0)) return;
    fit->mean = dgfemi_scale(1 / fit->weight, fit->mean);
    memset(&c, 0, sizeof c);
    for (int i = 0; i < query->count; i++) {
        dgfem_vec3 d = dgfemi_sub(dgfemi_query_offset(query, i, x), fit->mean);
        dgfemi_add_outer(&c, query->theta[i], d, d);
    }
    dgfem_eigen_symmetric(c, fit->moment, &fit->axes);
}

static int dgfemi_fit_is_flat(const dgfemi_fit *fit) { return !(fit->moment[0] > DGFEM_FLAT * fit->moment[2]); }

/* C^-1 v; directions in which the samples do not spread are left out. */
static dgfem_vec3 dgfemi_fit_solve(const dgfemi_fit *fit, dgfem_vec3 v) {
    dgfem_vec3 result = dgfemi_vec3(0, 0, 0);
    for (int i = 0; i < 3; i++) {
        dgfem_vec3 axis = dgfemi_column(&fit->axes, i);
        if (!(fit->moment[i] > DGFEM_FLAT * fit->moment[2])) continue;
        result = dgfemi_add_scaled(result, dgfemi_dot(axis, v) / fit->moment[i], axis);
    }
    return result;
}

/* Adds theta_k (value / W + (x_k - m)^T C^-1 slope) to the weights: sum phi grows by `value`, and sum phi (x_k - m) by
   `slope`. */
static void dgfemi_query_add_weights(dgfemi_query *query, const dgfemi_fit *fit, dgfem_vec3 x, dgfem_real value,
                                     dgfem_vec3 slope) {
    dgfem_vec3 z = dgfemi_fit_solve(fit, slope);
    for (int i = 0; i < query->count; i++) {
        dgfem_vec3 d = dgfemi_sub(dgfemi_query_offset(query, i, x), fit->mean);
        query->weight[i] += query->theta[i] * (value / fit->weight + dgfemi_dot(d, z));
    }
}

/* Weights at x from the windows in theta. What round-off has left of sum phi = 1 and sum phi (x_k - x) = 0 is put right
   by the same formula. */
static void dgfemi_query_weights(dgfemi_query *query, const dgfemi_fit *fit, dgfem_vec3 x) {
    dgfem_vec3 first = dgfemi_vec3(0, 0, 0);
    dgfem_real sum = 0;
    for (int i = 0; i < query->count; i++) query->weight[i] = 0;
    dgfemi_query_add_weights(query, fit, x, 1, dgfemi_scale(-1, fit->mean));
    for (int i = 0; i < query->count; i++) {
        sum += query->weight[i];
        first = dgfemi_add_scaled(first, query->weight[i], dgfemi_query_offset(query, i, x));
    }
    dgfemi_query_add_weights(query, fit, x, 1 - sum, dgfemi_add_scaled(dgfemi_scale(-1, first), -(1 - sum), fit->mean));
}

/* All samples of one element, alike. */
static void dgfemi_query_take_element(dgfemi_query *query, int element) {
    const dgfemi_sampling *sampling = query->sampling;
    query->count = 0;
    for (int i = sampling->element_start[element]; i < sampling->element_start[element + 1]; i++) {
        query->theta[query->count] = 1;
        query->sample[query->count++] = sampling->element_sample[i];
    }
}

/* Windows relative to the largest one, so that far samples alone do as well as near ones; those below round-off go. */
static void dgfemi_query_normalize(dgfemi_query *query) {
    dgfem_real largest = 0;
    int kept = 0;
    for (int i = 0; i < query->count; i++) largest = dgfemi_max(largest, query->theta[i]);
    for (int i = 0; i < query->count; i++) {
        dgfem_real theta = query->theta[i] / largest;
        if (!(theta > 0)) continue;
        query->theta[kept] = theta;
        query->sample[kept++] = query->sample[i];
    }
    query->count = kept;
}

/* Samples in ascending order: points that share samples read them alike. Insertion sort of some fifty. */
static void dgfemi_query_sort(dgfemi_query *query) {
    for (int i = 1; i < query->count; i++) {
        int sample = query->sample[i], j = i;
        dgfem_real theta = query->theta[i];
        for (; j > 0 && query->sample[j - 1] > sample; j--) {
            query->sample[j] = query->sample[j - 1];
            query->theta[j] = query->theta[j - 1];
        }
        query->sample[j] = sample;
        query->theta[j] = theta;
    }
}

/* ---- the embedding of points ---- */

/* Where the windows of a point are evaluated: at the point, but not far outside its element. The affine fit extends to
   the point itself, so linear fields are reproduced wherever it is. */
static dgfem_vec3 dgfemi_window_position(const dgfem_mesh *mesh, const dgfemi_location *location, dgfem_vec3 x) {
    dgfem_real limit = DGFEM_OUTSIDE * mesh->elements[location->element].radius;
    if (!(location->distance > limit)) return x;
    return dgfemi_add_scaled(location->nearest, limit / location->distance, dgfemi_sub(x, location->nearest));
}

/* Whether the samples that reach x, `round` enlargements on, determine the fit. */
static int dgfemi_query_is_served(const dgfemi_query *query, int home, dgfem_vec3 x, int round) {
    const dgfemi_sampling *sampling = query->sampling;
    dgfemi_fit fit;
    if (query->count == sampling->component_samples[sampling->component[home]]) return 1; /* there are no more */
    if (query->count < DGFEM_MIN_POINT_SAMPLES) return 0;
    if (round >= DGFEM_CONDITION_ROUNDS) return 1;
    dgfemi_query_fit(query, x, &fit);
    return fit.moment[0] * DGFEM_MAX_CONDITION > fit.moment[2];
}

static void dgfemi_mark_samples(const dgfemi_sampling *sampling, int element, char *enlarge) {
    for (int i = sampling->element_start[element]; i < sampling->element_start[element + 1]; i++)
        enlarge[sampling->element_sample[i]] = 1;
}

/* Marks the samples of the elements that the query has visited and of their neighbours. */
static void dgfemi_query_mark(const dgfemi_query *query, char *enlarge) {
    const dgfemi_sampling *sampling = query->sampling;
    for (int i = 0; i < query->visited_count; i++) {
        int e = query->visited[i];
        dgfemi_mark_samples(sampling, e, enlarge);
        for (int k = sampling->neighbour_start[e]; k < sampling->neighbour_start[e + 1]; k++)
            dgfemi_mark_samples(sampling, sampling->neighbour[k], enlarge);
    }
}

/* Enlarges the windows of the samples around poorly served points, once per round, until all points are served. `open`
   marks the points still to be looked at, `enlarge` the samples. */
static void dgfemi_enlarge_windows(dgfemi_query *query, const dgfem_embedding *embedding, const dgfem_vec3 *windows,
                                   char *open, char *enlarge) {
    dgfemi_sampling *sampling = query->sampling;
    memset(open, 1, (size_t)embedding->point_count);
    for (int round = 0; round < DGFEM_MAX_ROUNDS; round++) {
        int poor = 0;
        memset(enlarge, 0, (size_t)embedding->sample_count);
        for (int p = 0; p < embedding->point_count; p++) {
            if (!open[p]) continue;
            dgfemi_query_run(query, embedding->point_element[p], windows[p]);
            open[p] = !dgfemi_query_is_served(query, embedding->point_element[p], windows[p], round);
            if (!open[p]) continue;
            poor++;
            dgfemi_query_mark(query, enlarge);
        }
        if (poor == 0) return;
        for (int s = 0; s < embedding->sample_count; s++)
            if (enlarge[s]) sampling->radius[s] *= DGFEM_ENLARGE;
        dgfemi_sampling_update_reach(sampling);
    }
}

/* Appends the query's samples and weights as those of the next point. 1 on success. */
static int dgfemi_embedding_append(dgfem_embedding *embedding, const dgfemi_query *query, int point,
                                   int *sample_capacity, int *weight_capacity) {
    int first = embedding->weight_start[point], needed = first + query->count;
    if (query->count > INT_MAX - first) return 0;
    if (needed > *sample_capacity) {
        void *grown = dgfemi_grow(&embedding->hooks, embedding->weight_sample, sample_capacity, needed, sizeof(int));
        if (!grown) return 0;
        embedding->weight_sample = (int *)grown;
    }
    if (needed > *weight_capacity) {
        void *grown = dgfemi_grow(&embedding->hooks, embedding->weight, weight_capacity, needed, sizeof(dgfem_real));
        if (!grown) return 0;
        embedding->weight = (dgfem_real *)grown;
    }
    memcpy(embedding->weight_sample + first, query->sample, (size_t)query->count * sizeof(int));
    memcpy(embedding->weight + first, query->weight, (size_t)query->count * sizeof(dgfem_real));
    embedding->weight_start[point + 1] = needed;
    return 1;
}

/* Weights of all points. 1 on success, 0 when out of memory. */
static int dgfemi_embedding_weigh(dgfemi_query *query, dgfem_embedding *embedding, const dgfem_vec3 *windows) {
    int sample_capacity = 0, weight_capacity = 0;
    embedding->weight_start[0] = 0;
    for (int p = 0; p < embedding->point_count; p++) {
        dgfemi_fit fit;
        dgfemi_query_run(query, embedding->point_element[p], windows[p]);
        dgfemi_query_normalize(query);
        dgfemi_query_sort(query);
        dgfemi_query_fit(query, embedding->points[p], &fit);
        if (dgfemi_fit_is_flat(&fit)) {
            dgfemi_query_take_element(query, embedding->point_element[p]);
            dgfemi_query_fit(query, embedding->points[p], &fit);
        }
        dgfemi_query_weights(query, &fit, embedding->points[p]);
        if (!dgfemi_embedding_append(embedding, query, p, &sample_capacity, &weight_capacity)) return 0;
    }
    return 1;
}

/* Reads the points. DGFEM_ERROR_NOT_FINITE names the first bad one. */
static dgfem_status dgfemi_embedding_read_points(dgfem_embedding *embedding, const dgfem_points_in *points) {
    embedding->point_count = points->count;
    embedding->points = (dgfem_vec3 *)dgfemi_allocate(&embedding->hooks, (size_t)points->count, sizeof(dgfem_vec3));
    embedding->point_element = (int *)dgfemi_allocate(&embedding->hooks, (size_t)points->count, sizeof(int));
    embedding->weight_start = (int *)dgfemi_allocate_zero(&embedding->hooks, (size_t)points->count + 1, sizeof(int));
    if (!embedding->points || !embedding->point_element || !embedding->weight_start)
        return dgfemi_fail_memory(&embedding->hooks);
    for (int p = 0; p < points->count; p++) {
        embedding->points[p] = dgfemi_point_read(points, p);
        if (!dgfemi_is_finite3(embedding->points[p]))
            return dgfemi_fail(&embedding->hooks, DGFEM_ERROR_NOT_FINITE, "embedded point %d is (%g, %g, %g)", p,
                               (double)embedding->points[p].x, (double)embedding->points[p].y,
                               (double)embedding->points[p].z);
    }
    return DGFEM_OK;
}

/* Samples, locations and weights, with temporary memory from the arena. homes[p]: the element from which point p is
   reached, wherever it lies; DGFEM_NONE: the nearest one; homes may be NULL. 1 on success, 0 when out of memory. */
static int dgfemi_embedding_build(dgfemi_arena *arena, const dgfem_body *body, const dgfem_corners *corners,
                                  const int *homes, dgfem_embedding *embedding) {
    dgfemi_locator locator;
    dgfemi_sampling sampling;
    dgfemi_query query;
    dgfem_vec3 *windows;
    char *open, *enlarge;
    if (!dgfemi_embedding_choose_samples(arena, embedding, body, corners) ||
        !dgfemi_locator_make(arena, body->mesh, &locator) ||
        !dgfemi_sampling_make(arena, body->mesh, embedding, &locator, &sampling) ||
        !dgfemi_query_make(arena, &sampling, &query))
        return 0;
    windows = (dgfem_vec3 *)dgfemi_arena_allocate(arena, (size_t)embedding->point_count, sizeof(dgfem_vec3));
    open = (char *)dgfemi_arena_allocate(arena, (size_t)embedding->point_count, 1);
    enlarge = (char *)dgfemi_arena_allocate(arena, (size_t)embedding->sample_count, 1);
    if (!windows || !open || !enlarge) return 0;
    for (int p = 0; p < embedding->point_count; p++) {
        dgfem_vec3 x = embedding->points[p];
        dgfemi_location location = homes && homes[p] != DGFEM_NONE ? dgfemi_locate_in(body->mesh, homes[p], x)
                                                                   : dgfemi_locate(&locator, x);
        embedding->point_element[p] = location.element;
        windows[p] = dgfemi_window_position(body->mesh, &location, x);
    }
    dgfemi_enlarge_windows(&query, embedding, windows, open, enlarge);
    return dgfemi_embedding_weigh(&query, embedding, windows);
}

DGFEM_API void dgfem_embedding_destroy(dgfem_embedding *embedding) {
    dgfem_hooks hooks;
    if (!embedding) return;
    hooks = embedding->hooks;
    dgfemi_free(&hooks, embedding->samples);
    dgfemi_free(&hooks, embedding->term_start);
    dgfemi_free(&hooks, embedding->term_element);
    dgfemi_free(&hooks, embedding->term_basis_start);
    dgfemi_free(&hooks, embedding->term_basis);
    dgfemi_free(&hooks, embedding->points);
    dgfemi_free(&hooks, embedding->point_element);
    dgfemi_free(&hooks, embedding->weight_start);
    dgfemi_free(&hooks, embedding->weight_sample);
    dgfemi_free(&hooks, embedding->weight);
    dgfemi_free(&hooks, embedding);
}

static dgfem_embedding *dgfemi_embedding_new(const dgfem_body *body, const dgfem_hooks *hooks) {
    dgfem_embedding *embedding = (dgfem_embedding *)dgfemi_allocate_zero(hooks, 1, sizeof *embedding);
    if (!embedding) return NULL;
    embedding->hooks = *hooks;
    embedding->revision = body->revision;
    return embedding;
}

static dgfem_status dgfemi_embedding_create_at(const dgfem_body *body, const dgfem_points_in *points, const int *homes,
                                               const dgfem_hooks *hooks, dgfem_embedding **out) {
    dgfem_embedding *embedding = dgfemi_embedding_new(body, hooks);
    dgfem_corners *corners = NULL;
    dgfemi_arena arena = dgfemi_arena_make(hooks);
    dgfem_status status;
    if (!embedding) return dgfemi_fail_memory(hooks);
    status = dgfemi_embedding_read_points(embedding, points);
    if (status == DGFEM_OK) status = dgfem_mesh_corners(body->mesh, &corners);
    if (status == DGFEM_OK && !dgfemi_embedding_build(&arena, body, corners, homes, embedding))
        status = dgfemi_fail_memory(hooks);
    dgfemi_arena_free(&arena);
    dgfem_corners_destroy(corners);
    if (status != DGFEM_OK) {
        dgfem_embedding_destroy(embedding);
        return status;
    }
    *out = embedding;
    return DGFEM_OK;
}

static dgfem_status dgfemi_embedding_create(const dgfem_body *body, const dgfem_points_in *points,
                                            const dgfem_hooks *hooks, dgfem_embedding **out) {
    return dgfemi_embedding_create_at(body, points, NULL, hooks, out);
}

DGFEM_API dgfem_status dgfem_embedding_create(const dgfem_body *body, dgfem_points_in points, dgfem_embedding **out) {
    dgfem_status status;
    if (out) *out = NULL;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (!out) return dgfemi_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "embedding: no place for the result");
    status = dgfemi_check_points(&body->hooks, points.data, points.type, points.stride, points.count, "embedding");
    if (status != DGFEM_OK) return status;
    return dgfemi_embedding_create(body, &points, &body->hooks, out);
}

/* ---- evaluation ---- */

#define DGFEM_EMBEDDING_GRAIN 256

typedef struct dgfemi_embedding_range {
    const dgfem_embedding *embedding;
    const dgfem_body *body;
    const dgfem_vec3 *in;
    dgfem_vec3 *out;
} dgfemi_embedding_range;

static dgfem_vec3 dgfemi_embedding_sample(const dgfem_embedding *embedding, const dgfem_body *body,
                                          const dgfem_vec3 *coefficients, int sample) {
    int first = embedding->term_start[sample], last = embedding->term_start[sample + 1];
    dgfem_vec3 sum = dgfemi_vec3(0, 0, 0);
    for (int t = first; t < last; t++) {
        const dgfem_vec3 *u = coefficients + body->basis_start[embedding->term_element[t]];
        const dgfem_real *basis = embedding->term_basis + embedding->term_basis_start[t];
        int count = embedding->term_basis_start[t + 1] - embedding->term_basis_start[t];
        for (int i = 0; i < count; i++) sum = dgfemi_add_scaled(sum, basis[i], u[i]);
    }
    return dgfemi_scale(1 / (dgfem_real)(last - first), sum);
}

static void dgfemi_embedding_samples_range(void *context, int first, int last) {
    const dgfemi_embedding_range *range = (const dgfemi_embedding_range *)context;
    for (int s = first; s < last; s++)
        range->out[s] = dgfemi_embedding_sample(range->embedding, range->body, range->in, s);
}

static void dgfemi_embedding_points_range(void *context, int first, int last) {
    const dgfemi_embedding_range *range = (const dgfemi_embedding_range *)context;
    const dgfem_embedding *embedding = range->embedding;
    for (int p = first; p < last; p++) {
        dgfem_vec3 sum = dgfemi_vec3(0, 0, 0);
        for (int i = embedding->weight_start[p]; i < embedding->weight_start[p + 1]; i++)
            sum = dgfemi_add_scaled(sum, embedding->weight[i], range->in[embedding->weight_sample[i]]);
        range->out[p] = sum;
    }
}

/* out[sample_count]: the samples' means of the polynomials with these coefficients (displacement, velocity). */
static void dgfemi_embedding_samples(const dgfem_embedding *embedding, const dgfem_body *body,
                                     const dgfem_vec3 *coefficients, dgfem_vec3 *out) {
    dgfemi_embedding_range range;
    DGFEM_ASSERT(embedding->revision == body->revision);
    range.embedding = embedding, range.body = body, range.in = coefficients, range.out = out;
    dgfemi_parallel_for(&embedding->hooks, embedding->sample_count, DGFEM_EMBEDDING_GRAIN,
                        dgfemi_embedding_samples_range, &range);
}

/* out[point_count]: weighted sums of the samples' values. */
static void dgfemi_embedding_points(const dgfem_embedding *embedding, const dgfem_vec3 *sample_values,
                                    dgfem_vec3 *out) {
    dgfemi_embedding_range range;
    range.embedding = embedding, range.body = NULL, range.in = sample_values, range.out = out;
    dgfemi_parallel_for(&embedding->hooks, embedding->point_count, DGFEM_EMBEDDING_GRAIN, dgfemi_embedding_points_range,
                        &range);
}
