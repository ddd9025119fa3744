#pragma once
#include "embed.c"
/* Embedding of points, second part: where each point sits, windows large enough for all, weights; what an earlier
   embedding leaves to be kept; evaluation. */

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
   marks the points still to be looked at, `enlarge` is room for marks of the samples. */
static void dgfemi_enlarge_windows(dgfemi_query *query, const dgfem_embedding *embedding, const dgfem_vec3 *windows,
                                   char *open, char *enlarge) {
    dgfemi_sampling *sampling = query->sampling;
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

/* ---- what an earlier embedding leaves ----

   After a change of topology most weights are as they were. An element is the same if it has the same centre and as
   many glued faces, a sample if it has the same place and elements. A point keeps its weights if its place, its element and
   its samples are the same, and neither a changed element nor a new sample lies within reach. */

typedef struct dgfemi_reuse {
    const dgfem_embedding *old;
    int *old_element;   /* [elements] DGFEM_NONE: changed */
    int *new_element;   /* [old elements] */
    int *new_sample;    /* [old samples] DGFEM_NONE: gone */
    char *known;        /* [samples] 1: an old one */
    dgfem_real *radius; /* [samples] before any was enlarged */
    char *keep;         /* [points] */
} dgfemi_reuse;

static uint64_t dgfemi_hash_position(dgfem_vec3 x) {
    uint64_t hash = 0;
    for (int axis = 0; axis < 3; axis++) {
        double value = (double)dgfemi_axis(x, axis) + 0.0; /* one zero */
        uint64_t bits;
        memcpy(&bits, &value, sizeof bits);
        hash = dgfemi_mix(hash ^ bits);
    }
    return hash;
}

static int dgfemi_same_position(dgfem_vec3 a, dgfem_vec3 b) { return a.x == b.x && a.y == b.y && a.z == b.z; }

/* Notes what a later embedding compares with. 1 on success. */
static int dgfemi_embedding_sign(dgfem_embedding *embedding, const dgfemi_sampling *sampling) {
    const dgfem_mesh *mesh = sampling->mesh;
    const dgfem_hooks *hooks = &embedding->hooks;
    embedding->sample_radius =
        (dgfem_real *)dgfemi_duplicate(hooks, sampling->radius, (size_t)embedding->sample_count, sizeof(dgfem_real));
    embedding->element_count = mesh->element_count;
    embedding->element_centre = (dgfem_vec3 *)dgfemi_allocate(hooks, (size_t)mesh->element_count, sizeof(dgfem_vec3));
    embedding->element_glue = (int *)dgfemi_allocate(hooks, (size_t)mesh->element_count, sizeof(int));
    if (!embedding->sample_radius || !embedding->element_centre || !embedding->element_glue) return 0;
    for (int e = 0; e < mesh->element_count; e++) {
        embedding->element_centre[e] = mesh->elements[e].centre;
        embedding->element_glue[e] = sampling->neighbour_start[e + 1] - sampling->neighbour_start[e];
    }
    return 1;
}

/* Finds the elements that are the same. */
static int dgfemi_reuse_match_elements(dgfemi_reuse *reuse, const dgfemi_sampling *sampling, dgfemi_buckets *buckets) {
    const dgfem_embedding *old = reuse->old;
    const dgfem_mesh *mesh = sampling->mesh;
    const dgfem_hooks *hooks = &sampling->embedding->hooks;
    if (!dgfemi_buckets_reset(hooks, buckets, old->element_count)) return 0;
    for (int e = 0; e < old->element_count; e++) {
        reuse->new_element[e] = DGFEM_NONE;
        if (!dgfemi_buckets_insert(hooks, buckets, e, dgfemi_hash_position(old->element_centre[e]))) return 0;
    }
    for (int e = 0; e < mesh->element_count; e++) {
        int glue = sampling->neighbour_start[e + 1] - sampling->neighbour_start[e];
        int i = dgfemi_buckets_first(buckets, dgfemi_hash_position(mesh->elements[e].centre));
        while (i != DGFEM_NONE && (!dgfemi_same_position(old->element_centre[i], mesh->elements[e].centre) ||
                                   old->element_glue[i] != glue))
            i = buckets->next[i];
        reuse->old_element[e] = i;
        if (i != DGFEM_NONE) reuse->new_element[i] = e;
    }
    return 1;
}

/* Whether a sample has the same elements as an old one. */
static int dgfemi_reuse_same_terms(const dgfemi_reuse *reuse, const dgfem_embedding *embedding, int sample, int old) {
    const int *terms = embedding->term_start, *old_terms = reuse->old->term_start;
    if (terms[sample + 1] - terms[sample] != old_terms[old + 1] - old_terms[old]) return 0;
    for (int i = old_terms[old]; i < old_terms[old + 1]; i++) {
        int element = reuse->new_element[reuse->old->term_element[i]], found = 0;
        for (int t = terms[sample]; t < terms[sample + 1]; t++) found |= embedding->term_element[t] == element;
        if (!found) return 0;
    }
    return 1;
}

/* Finds the samples that are the same; they keep their windows. */
static int dgfemi_reuse_match_samples(dgfemi_reuse *reuse, dgfemi_sampling *sampling, dgfemi_buckets *buckets) {
    const dgfem_embedding *old = reuse->old, *embedding = sampling->embedding;
    const dgfem_hooks *hooks = &embedding->hooks;
    if (!dgfemi_buckets_reset(hooks, buckets, old->sample_count)) return 0;
    for (int s = 0; s < old->sample_count; s++) {
        reuse->new_sample[s] = DGFEM_NONE;
        if (!dgfemi_buckets_insert(hooks, buckets, s, dgfemi_hash_position(old->samples[s]))) return 0;
    }
    for (int s = 0; s < embedding->sample_count; s++) {
        int i = dgfemi_buckets_first(buckets, dgfemi_hash_position(embedding->samples[s]));
        while (i != DGFEM_NONE && (!dgfemi_same_position(old->samples[i], embedding->samples[s]) ||
                                   !dgfemi_reuse_same_terms(reuse, embedding, s, i)))
            i = buckets->next[i];
        reuse->known[s] = i != DGFEM_NONE;
        if (i == DGFEM_NONE) continue;
        reuse->new_sample[i] = s;
        sampling->radius[s] = old->sample_radius[i];
    }
    memcpy(reuse->radius, sampling->radius, (size_t)embedding->sample_count * sizeof(dgfem_real));
    return 1;
}

/* Whether nothing that has changed reaches a place. */
static int dgfemi_reuse_is_quiet(const dgfemi_reuse *reuse, const dgfemi_sampling *sampling, dgfem_real reach,
                                 dgfem_vec3 x) {
    const dgfem_embedding *embedding = sampling->embedding;
    for (int e = 0; e < sampling->mesh->element_count; e++)
        if (reuse->old_element[e] == DGFEM_NONE && dgfemi_sampling_distance(sampling, e, x) < reach) return 0;
    for (int s = 0; s < embedding->sample_count; s++)
        if (!reuse->known[s] && dgfemi_distance(embedding->samples[s], x) < sampling->radius[s]) return 0;
    return 1;
}

static int dgfemi_reuse_has_samples(const dgfemi_reuse *reuse, int point) {
    for (int i = reuse->old->weight_start[point]; i < reuse->old->weight_start[point + 1]; i++)
        if (reuse->new_sample[reuse->old->weight_sample[i]] == DGFEM_NONE) return 0;
    return 1;
}

/* Decides which points keep their weights. 1 on success. */
static int dgfemi_reuse_make(dgfemi_arena *arena, dgfemi_reuse *reuse, dgfemi_sampling *sampling,
                             const dgfem_vec3 *windows) {
    const dgfem_embedding *old = reuse->old, *embedding = sampling->embedding;
    size_t elements = (size_t)sampling->mesh->element_count, samples = (size_t)embedding->sample_count;
    dgfemi_buckets buckets;
    dgfem_real reach = 0;
    int ok;
    reuse->old_element = (int *)dgfemi_arena_allocate(arena, elements, sizeof(int));
    reuse->new_element = (int *)dgfemi_arena_allocate(arena, (size_t)old->element_count, sizeof(int));
    reuse->new_sample = (int *)dgfemi_arena_allocate(arena, (size_t)old->sample_count, sizeof(int));
    reuse->known = (char *)dgfemi_arena_allocate(arena, samples, 1);
    reuse->radius = (dgfem_real *)dgfemi_arena_allocate(arena, samples, sizeof(dgfem_real));
    if (!reuse->old_element || !reuse->new_element || !reuse->new_sample || !reuse->known || !reuse->radius) return 0;
    memset(&buckets, 0, sizeof buckets);
    ok =
        dgfemi_reuse_match_elements(reuse, sampling, &buckets) && dgfemi_reuse_match_samples(reuse, sampling, &buckets);
    dgfemi_buckets_free(&embedding->hooks, &buckets);
    if (!ok) return 0;
    dgfemi_sampling_update_reach(sampling);
    for (int s = 0; s < embedding->sample_count; s++) reach = dgfemi_max(reach, sampling->radius[s]);
    for (int p = 0; p < embedding->point_count && p < old->point_count; p++)
        reuse->keep[p] = reuse->old_element[embedding->point_element[p]] == old->point_element[p] &&
                         dgfemi_same_position(embedding->points[p], old->points[p]) &&
                         dgfemi_reuse_has_samples(reuse, p) &&
                         dgfemi_reuse_is_quiet(reuse, sampling, reach, windows[p]);
    return 1;
}

/* Windows that have grown since may reach further points. */
static void dgfemi_reuse_revise(dgfemi_reuse *reuse, const dgfemi_sampling *sampling, const dgfem_vec3 *windows) {
    const dgfem_embedding *embedding = sampling->embedding;
    for (int s = 0; s < embedding->sample_count; s++) {
        if (!(sampling->radius[s] > reuse->radius[s])) continue;
        for (int p = 0; p < embedding->point_count; p++)
            if (dgfemi_distance(embedding->samples[s], windows[p]) < sampling->radius[s]) reuse->keep[p] = 0;
    }
}

/* The old weights of a point, as if they had been computed. */
static void dgfemi_reuse_weights(const dgfemi_reuse *reuse, int point, dgfemi_query *query) {
    const dgfem_embedding *old = reuse->old;
    query->count = 0;
    for (int i = old->weight_start[point]; i < old->weight_start[point + 1]; i++) {
        query->sample[query->count] = reuse->new_sample[old->weight_sample[i]];
        query->theta[query->count++] = old->weight[i];
    }
    dgfemi_query_sort(query);
    memcpy(query->weight, query->theta, (size_t)query->count * sizeof(dgfem_real));
}

/* Weights of all points, kept or new. 1 on success, 0 when out of memory. */
static int dgfemi_embedding_weigh(dgfemi_query *query, dgfem_embedding *embedding, const dgfem_vec3 *windows,
                                  const dgfemi_reuse *reuse) {
    int sample_capacity = 0, weight_capacity = 0;
    embedding->weight_start[0] = 0;
    for (int p = 0; p < embedding->point_count; p++) {
        dgfemi_fit fit;
        if (reuse->keep[p]) {
            dgfemi_reuse_weights(reuse, p, query);
            if (!dgfemi_embedding_append(embedding, query, p, &sample_capacity, &weight_capacity)) return 0;
            continue;
        }
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
   reached, wherever it lies; DGFEM_NONE: the nearest one; homes may be NULL. `old`, of the same first points before the
   body's topology changed, may be NULL. 1 on success, 0 when out of memory. */
static int dgfemi_embedding_build(dgfemi_arena *arena, const dgfem_body *body, const dgfem_corners *corners,
                                  const int *homes, const dgfem_embedding *old, dgfem_embedding *embedding) {
    dgfemi_locator locator;
    dgfemi_reuse reuse;
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
    memset(&reuse, 0, sizeof reuse);
    reuse.old = old;
    reuse.keep = (char *)dgfemi_arena_allocate_zero(arena, (size_t)embedding->point_count, 1);
    if (!windows || !open || !enlarge || !reuse.keep) return 0;
    for (int p = 0; p < embedding->point_count; p++) {
        dgfem_vec3 x = embedding->points[p];
        dgfemi_location location =
            homes && homes[p] != DGFEM_NONE ? dgfemi_locate_in(body->mesh, homes[p], x) : dgfemi_locate(&locator, x);
        embedding->point_element[p] = location.element;
        windows[p] = dgfemi_window_position(body->mesh, &location, x);
    }
    if (old && !dgfemi_reuse_make(arena, &reuse, &sampling, windows)) return 0;
    for (int p = 0; p < embedding->point_count; p++) open[p] = !reuse.keep[p];
    dgfemi_enlarge_windows(&query, embedding, windows, open, enlarge);
    if (old) dgfemi_reuse_revise(&reuse, &sampling, windows);
    return dgfemi_embedding_weigh(&query, embedding, windows, &reuse) && dgfemi_embedding_sign(embedding, &sampling);
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
    dgfemi_free(&hooks, embedding->sample_radius);
    dgfemi_free(&hooks, embedding->element_centre);
    dgfemi_free(&hooks, embedding->element_glue);
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
                                               const dgfem_embedding *old, const dgfem_hooks *hooks,
                                               dgfem_embedding **out) {
    dgfem_embedding *embedding = dgfemi_embedding_new(body, hooks);
    dgfem_corners *corners = NULL;
    dgfemi_arena arena = dgfemi_arena_make(hooks);
    dgfem_status status;
    if (!embedding) return dgfemi_fail_memory(hooks);
    status = dgfemi_embedding_read_points(embedding, points);
    if (status == DGFEM_OK) status = dgfem_mesh_corners(body->mesh, &corners);
    if (status == DGFEM_OK && !dgfemi_embedding_build(&arena, body, corners, homes, old, embedding))
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
    return dgfemi_embedding_create_at(body, points, NULL, NULL, hooks, out);
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
