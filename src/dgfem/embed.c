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

/* Squared distance from the element's box. */
static dgfem_real dgfemi_sampling_square(const dgfemi_sampling *sampling, int element, dgfem_vec3 x) {
    return dgfemi_box_square(sampling->locator->lower[element], sampling->locator->upper[element], x);
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
    dgfem_vec3 x = embedding->samples[sample];
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
            sampling->mark[neighbour] = sampling->stamp;
            if (dgfemi_sampling_square(sampling, neighbour, x) < radius * radius) sampling->stack[depth++] = neighbour;
        }
    }
}

static void dgfemi_sampling_update_reach(dgfemi_sampling *sampling) {
    for (int e = 0; e < sampling->mesh->element_count; e++) sampling->reach[e] = 0;
    for (int s = 0; s < sampling->embedding->sample_count; s++) dgfemi_sampling_flood(sampling, s);
}

/* Without `reach`, which follows when the windows are known. 1 on success, 0 when out of memory. */
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
    return 1;
}

/* ---- query: the samples that reach a point ---- */

typedef struct dgfemi_query {
    dgfemi_sampling *sampling;
    int *element_mark, *sample_mark, stamp; /* query that met the element, the sample last */
    dgfem_real *way; /* [elements] squared distance of the farthest element that must be passed to get there, itself
                        included */
    int *heap;       /* [elements] elements to visit, the one with the shortest way on top */
    int heap_count;
    int *visited; /* [elements] in the order of their ways */
    int visited_count;
    int *sample;        /* [samples] that reach the point */
    dgfem_real *theta;  /* [samples] their windows */
    dgfem_real *weight; /* [samples] their weights */
    int count;
    int *spare_sample; /* [samples] for sorting, as are */
    dgfem_real *spare_theta;
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
    query->spare_sample = (int *)dgfemi_arena_allocate(arena, samples, sizeof(int));
    query->spare_theta = (dgfem_real *)dgfemi_arena_allocate(arena, samples, sizeof(dgfem_real));
    if (!query->spare_sample || !query->spare_theta) return 0;
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

static dgfem_real dgfemi_window(dgfem_real square) {
    dgfem_real rest = 1 - square;
    return (dgfem_real)exp(-2 * (double)square) * rest * rest * rest;
}

/* Accepts the samples of an element just visited. The first visit of a sample comes by its shortest way. */
static void dgfemi_query_accept(dgfemi_query *query, int element, dgfem_vec3 x) {
    const dgfemi_sampling *sampling = query->sampling;
    for (int i = sampling->element_start[element]; i < sampling->element_start[element + 1]; i++) {
        int s = sampling->element_sample[i];
        dgfem_real square, limit = sampling->radius[s] * sampling->radius[s];
        dgfem_vec3 d;
        if (query->sample_mark[s] == query->stamp) continue;
        query->sample_mark[s] = query->stamp;
        d = dgfemi_sub(sampling->embedding->samples[s], x);
        square = dgfemi_max(query->way[element], dgfemi_dot(d, d));
        if (!(square < limit)) continue;
        query->theta[query->count] = dgfemi_window(square / limit);
        query->sample[query->count++] = s;
    }
}

/* Finds the samples that reach x from the element `home`: elements are visited in the order of their ways, the way of a
   neighbour being max(way, distance from x to the neighbour's box). The first way to an element is its shortest one. */
static void dgfemi_query_run(dgfemi_query *query, int home, dgfem_vec3 x) {
    const dgfemi_sampling *sampling = query->sampling;
    query->stamp++;
    query->count = query->heap_count = query->visited_count = 0;
    query->element_mark[home] = query->stamp;
    dgfemi_query_push(query, home, 0);
    while (query->heap_count > 0) {
        int e = dgfemi_query_pop(query);
        query->visited[query->visited_count++] = e;
        dgfemi_query_accept(query, e, x);
        for (int k = sampling->neighbour_start[e]; k < sampling->neighbour_start[e + 1]; k++) {
            int neighbour = sampling->neighbour[k];
            dgfem_real way;
            if (query->element_mark[neighbour] == query->stamp) continue;
            query->element_mark[neighbour] = query->stamp;
            way = dgfemi_max(query->way[e], dgfemi_sampling_square(sampling, neighbour, x));
            if (way < sampling->reach[neighbour] * sampling->reach[neighbour]) dgfemi_query_push(query, neighbour, way);
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
    dgfem_real xx = 0, yy = 0, zz = 0, xy = 0, xz = 0, yz = 0;
    dgfem_mat3 c;
    memset(fit, 0, sizeof *fit);
    for (int i = 0; i < query->count; i++) {
        fit->weight += query->theta[i];
        fit->mean = dgfemi_add_scaled(fit->mean, query->theta[i], dgfemi_query_offset(query, i, x));
    }
    if (!(fit->weight > 0)) return;
    fit->mean = dgfemi_scale(1 / fit->weight, fit->mean);
    for (int i = 0; i < query->count; i++) {
        dgfem_vec3 d = dgfemi_sub(dgfemi_query_offset(query, i, x), fit->mean);
        dgfem_vec3 t = dgfemi_scale(query->theta[i], d);
        xx += t.x * d.x, yy += t.y * d.y, zz += t.z * d.z;
        xy += t.x * d.y, xz += t.x * d.z, yz += t.y * d.z;
    }
    c.m[0][0] = xx, c.m[1][1] = yy, c.m[2][2] = zz;
    c.m[0][1] = c.m[1][0] = xy, c.m[0][2] = c.m[2][0] = xz, c.m[1][2] = c.m[2][1] = yz;
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

#define DGFEM_DIGIT 6 /* bits */

/* Samples and their theta in ascending order: points that share samples read them alike. Some fifty of thousands:
   sorted by their digits, the lowest first. */
static void dgfemi_query_sort(dgfemi_query *query) {
    int digits = 1 << DGFEM_DIGIT;
    for (int shift = 0; query->sampling->embedding->sample_count >> shift > 0; shift += DGFEM_DIGIT) {
        int start[1 << DGFEM_DIGIT] = {0}, total = 0;
        int *sample = query->sample;
        dgfem_real *theta = query->theta;
        for (int i = 0; i < query->count; i++) start[sample[i] >> shift & (digits - 1)]++;
        for (int d = 0; d < digits; d++) {
            int count = start[d];
            start[d] = total;
            total += count;
        }
        for (int i = 0; i < query->count; i++) {
            int to = start[sample[i] >> shift & (digits - 1)]++;
            query->spare_sample[to] = sample[i];
            query->spare_theta[to] = theta[i];
        }
        query->sample = query->spare_sample, query->spare_sample = sample;
        query->theta = query->spare_theta, query->spare_theta = theta;
    }
}
