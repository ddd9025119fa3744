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

static int dgfemi_same_position(dgfem_vec3 a, dgfem_vec3 b) { return a.x == b.x && a.y == b.y && a.z == b.z; }

#define DGFEM_THINNING DGFEM_R(0.5) /* of the mean radius: a corner that near to a kept sample of its elements may go */
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

/* ---- sampling: which samples an element has, and how far they see ---- */

#define DGFEM_WINDOW DGFEM_R(2.309401076758503) /* R_k / mean radius: two edges of a cube */

typedef struct dgfemi_sampling {
    const dgfem_mesh *mesh;
    const dgfem_embedding *embedding; /* its samples and terms are set */
    const dgfemi_locator *locator;
    int *element_start, *element_sample; /* samples of each element that it is the first one of, ascending */
    int *neighbour_start, *neighbour;    /* glued neighbours of each element */
    dgfem_real *radius;                  /* [samples] R_k */
    dgfem_real *widest;                  /* [buckets of the locator] the largest R_k of windows that may touch it */
    int *component;                      /* [elements] glued component */
    int *component_samples;              /* [components] number of samples */
} dgfemi_sampling;

/* stack: room for all elements. */
static void dgfemi_sampling_components(dgfemi_sampling *sampling, int *stack) {
    int components = dgfemi_mesh_pieces(sampling->mesh, sampling->component, stack);
    for (int i = 0; i < components; i++) sampling->component_samples[i] = 0;
    for (int s = 0; s < sampling->embedding->sample_count; s++) {
        int element = sampling->embedding->term_element[sampling->embedding->term_start[s]];
        sampling->component_samples[sampling->component[element]]++;
    }
}

/* Lists the samples by their first elements; `fill` is zero. */
static void dgfemi_sampling_list(dgfemi_sampling *sampling, int *fill) {
    const dgfem_embedding *embedding = sampling->embedding;
    int total = 0;
    for (int s = 0; s < embedding->sample_count; s++) fill[embedding->term_element[embedding->term_start[s]]]++;
    for (int e = 0; e < sampling->mesh->element_count; e++) {
        int count = fill[e];
        sampling->element_start[e] = fill[e] = total;
        total += count;
    }
    sampling->element_start[sampling->mesh->element_count] = total;
    for (int s = 0; s < embedding->sample_count; s++)
        sampling->element_sample[fill[embedding->term_element[embedding->term_start[s]]]++] = s;
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

/* Fills `widest`, when the windows are known. */
static void dgfemi_sampling_spread(dgfemi_sampling *sampling) {
    const dgfemi_locator *locator = sampling->locator;
    for (int b = 0; b < dgfemi_locator_bucket_count(locator); b++) sampling->widest[b] = 0;
    for (int s = 0; s < sampling->embedding->sample_count; s++) {
        dgfem_real radius = sampling->radius[s];
        dgfem_vec3 x = sampling->embedding->samples[s], r = dgfemi_vec3(radius, radius, radius);
        dgfemi_locator_range range = dgfemi_locator_range_of(locator, dgfemi_sub(x, r), dgfemi_add(x, r));
        for (int k = range.first[2]; k <= range.last[2]; k++)
            for (int j = range.first[1]; j <= range.last[1]; j++) {
                dgfem_real *row = sampling->widest + dgfemi_locator_bucket(locator, 0, j, k);
                for (int i = range.first[0]; i <= range.last[0]; i++) row[i] = dgfemi_max(row[i], radius);
            }
    }
}

/* No window that touches the box has a larger radius. */
static dgfem_real dgfemi_sampling_reach(const dgfemi_sampling *sampling, dgfem_vec3 lower, dgfem_vec3 upper) {
    const dgfemi_locator *locator = sampling->locator;
    dgfemi_locator_range range = dgfemi_locator_range_of(locator, lower, upper);
    dgfem_real reach = 0;
    for (int k = range.first[2]; k <= range.last[2]; k++)
        for (int j = range.first[1]; j <= range.last[1]; j++)
            for (int i = range.first[0]; i <= range.last[0]; i++)
                reach = dgfemi_max(reach, sampling->widest[dgfemi_locator_bucket(locator, i, j, k)]);
    return reach;
}

/* Without `widest`, which follows when the windows are known. 1 on success, 0 when out of memory. */
static int dgfemi_sampling_make(dgfemi_arena *arena, const dgfem_mesh *mesh, const dgfem_embedding *embedding,
                                const dgfemi_locator *locator, dgfemi_sampling *sampling) {
    size_t elements = (size_t)mesh->element_count, samples = (size_t)embedding->sample_count;
    size_t buckets = (size_t)dgfemi_locator_bucket_count(locator);
    int *fill = (int *)dgfemi_arena_allocate_zero(arena, 2 * elements, sizeof(int));
    memset(sampling, 0, sizeof *sampling);
    sampling->mesh = mesh, sampling->embedding = embedding, sampling->locator = locator;
    sampling->element_start = (int *)dgfemi_arena_allocate(arena, elements + 1, sizeof(int));
    sampling->element_sample = (int *)dgfemi_arena_allocate(arena, samples, sizeof(int));
    sampling->neighbour_start = (int *)dgfemi_arena_allocate(arena, elements + 1, sizeof(int));
    sampling->neighbour = (int *)dgfemi_arena_allocate(arena, 2 * (size_t)mesh->face_count, sizeof(int));
    sampling->radius = (dgfem_real *)dgfemi_arena_allocate(arena, samples, sizeof(dgfem_real));
    sampling->widest = (dgfem_real *)dgfemi_arena_allocate(arena, buckets, sizeof(dgfem_real));
    sampling->component = (int *)dgfemi_arena_allocate(arena, elements, sizeof(int));
    sampling->component_samples = (int *)dgfemi_arena_allocate(arena, elements, sizeof(int));
    if (!fill || !sampling->element_start || !sampling->element_sample || !sampling->neighbour_start ||
        !sampling->neighbour || !sampling->radius || !sampling->widest || !sampling->component ||
        !sampling->component_samples)
        return 0;
    dgfemi_sampling_list(sampling, fill);
    dgfemi_sampling_neighbours(sampling, fill + mesh->element_count);
    dgfemi_sampling_components(sampling, fill);
    for (int s = 0; s < embedding->sample_count; s++) {
        int first = embedding->term_start[s], count = embedding->term_start[s + 1] - first;
        sampling->radius[s] = DGFEM_WINDOW * dgfemi_mean_radius(mesh, embedding->term_element + first, count);
    }
    return 1;
}
