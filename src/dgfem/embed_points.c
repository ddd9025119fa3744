#pragma once
#include "embed_view.c"
/* Embedding of points, third part: where each point sits, windows large enough for all; what an earlier
   embedding leaves to be kept; evaluation. */

/* ---- the places of points ---- */

#define DGFEM_OUTSIDE DGFEM_R(0.5) /* of the radius: windows are not evaluated farther outside an element */

/* Where the windows of a point are evaluated: at the point, but not far outside its element. The affine fit extends to
   the point itself, so linear fields are reproduced wherever it is. */
static dgfem_vec3 dgfemi_window_position(const dgfem_mesh *mesh, const dgfemi_location *location, dgfem_vec3 x) {
    dgfem_real limit = DGFEM_OUTSIDE * mesh->elements[location->element].radius;
    if (!(location->distance > limit)) return x;
    return dgfemi_add_scaled(location->nearest, limit / location->distance, dgfemi_sub(x, location->nearest));
}

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

/* Which elements are those of an earlier embedding: the same centre and as many glued faces. */
typedef struct dgfemi_kinship {
    int *old_element; /* [elements] DGFEM_NONE: changed */
    int *new_element; /* [old elements] DGFEM_NONE: changed or gone */
} dgfemi_kinship;

static void dgfemi_kinship_match(const dgfem_mesh *mesh, const dgfem_embedding *old, const int *glue,
                                 const dgfemi_buckets *buckets, dgfemi_kinship *kinship) {
    for (int e = 0; e < mesh->element_count; e++) {
        dgfem_vec3 centre = mesh->elements[e].centre;
        int i = dgfemi_buckets_first(buckets, dgfemi_hash_position(centre));
        while (i != DGFEM_NONE &&
               (!dgfemi_same_position(old->element_centre[i], centre) || old->element_glue[i] != glue[e]))
            i = buckets->next[i];
        kinship->old_element[e] = i;
        if (i != DGFEM_NONE) kinship->new_element[i] = e;
    }
}

/* 1 on success, 0 when out of memory. */
static int dgfemi_kinship_make(dgfemi_arena *arena, const dgfem_mesh *mesh, const dgfem_embedding *old,
                               dgfemi_kinship *kinship) {
    const dgfem_hooks *hooks = &old->hooks;
    int *glue = (int *)dgfemi_arena_allocate_zero(arena, (size_t)mesh->element_count, sizeof(int));
    dgfemi_buckets buckets;
    int ok;
    kinship->old_element = (int *)dgfemi_arena_allocate(arena, (size_t)mesh->element_count, sizeof(int));
    kinship->new_element = (int *)dgfemi_arena_allocate(arena, (size_t)old->element_count, sizeof(int));
    if (!glue || !kinship->old_element || !kinship->new_element) return 0;
    for (int f = 0; f < mesh->face_count; f++) {
        const dgfem_face *face = &mesh->faces[f];
        if (face->element[1] != DGFEM_NONE && !face->cut) glue[face->element[0]]++, glue[face->element[1]]++;
    }
    memset(&buckets, 0, sizeof buckets);
    ok = dgfemi_buckets_reset(hooks, &buckets, old->element_count);
    for (int e = 0; ok && e < old->element_count; e++) {
        kinship->new_element[e] = DGFEM_NONE;
        ok = dgfemi_buckets_insert(hooks, &buckets, e, dgfemi_hash_position(old->element_centre[e]));
    }
    if (ok) dgfemi_kinship_match(mesh, old, glue, &buckets, kinship);
    dgfemi_buckets_free(hooks, &buckets);
    return ok;
}

/* Where points are reached from. */
typedef struct dgfemi_places {
    int *element;            /* [points] */
    dgfem_vec3 *window;      /* [points] where windows are evaluated */
    dgfemi_locator *locator; /* that found them */
} dgfemi_places;

/* 1 on success, 0 when out of memory. */
static int dgfemi_places_allocate(dgfemi_arena *arena, int count, dgfemi_locator *locator, dgfemi_places *places) {
    places->locator = locator;
    places->element = (int *)dgfemi_arena_allocate(arena, (size_t)count, sizeof(int));
    places->window = (dgfem_vec3 *)dgfemi_arena_allocate(arena, (size_t)count, sizeof(dgfem_vec3));
    return places->element && places->window;
}

/* Points stay in elements that have stayed; others are reached from the element at their anchor, or where they have
   none (`anchors` may be NULL), at the point. `old`, of the same first points, and its kinship may be NULL. */
static void dgfemi_places_find(const dgfem_vec3 *points, const dgfem_vec3 *anchors, int count,
                               const dgfem_embedding *old, const dgfemi_kinship *kinship, dgfemi_places *places) {
    const dgfem_mesh *mesh = places->locator->mesh;
    for (int p = 0; p < count; p++) {
        int home = DGFEM_NONE;
        dgfemi_location location;
        if (old && p < old->point_count && dgfemi_same_position(points[p], old->points[p]))
            home = kinship->new_element[old->point_element[p]];
        if (home != DGFEM_NONE) {
            places->element[p] = home, places->window[p] = old->point_window[p];
            continue;
        }
        location = dgfemi_locate(places->locator, anchors ? anchors[p] : points[p]);
        if (anchors && !dgfemi_same_position(anchors[p], points[p]))
            location = dgfemi_locate_in(mesh, location.element, points[p]);
        places->element[p] = location.element;
        places->window[p] = dgfemi_window_position(mesh, &location, points[p]);
    }
}

/* ---- what an earlier embedding leaves ----

   After a change of topology most weights are as they were. A sample is the same if it has the same place and elements;
   it keeps the window that it had, so that weights around it do not change without a cause: where a window was enlarged
   for the sake of a point that is better off now, it stays large. So windows depend on what was before, but what must
   hold of weights holds in any case. A point keeps its weights if its place, its element and its samples are the same,
   and neither an element come or gone nor a new sample lies within reach. */

/* A box that changes the weights of points within `limit` of it, as far as windows go there. */
typedef struct dgfemi_disturbance {
    dgfem_vec3 lower, upper;
    dgfem_real limit;
} dgfemi_disturbance;

/* Points by their elements. */
typedef struct dgfemi_crowds {
    int *start, *point;        /* points of each element */
    dgfem_vec3 *lower, *upper; /* [elements] box of their windows */
} dgfemi_crowds;

static int dgfemi_crowds_make(dgfemi_arena *arena, const dgfem_embedding *embedding, int element_count,
                              dgfemi_crowds *crowds) {
    size_t elements = (size_t)element_count;
    crowds->start = (int *)dgfemi_arena_allocate_zero(arena, elements + 1, sizeof(int));
    crowds->point = (int *)dgfemi_arena_allocate(arena, (size_t)embedding->point_count, sizeof(int));
    crowds->lower = (dgfem_vec3 *)dgfemi_arena_allocate(arena, elements, sizeof(dgfem_vec3));
    crowds->upper = (dgfem_vec3 *)dgfemi_arena_allocate(arena, elements, sizeof(dgfem_vec3));
    if (!crowds->start || !crowds->point || !crowds->lower || !crowds->upper) return 0;
    for (int p = 0; p < embedding->point_count; p++) {
        int e = embedding->point_element[p];
        dgfem_vec3 x = embedding->point_window[p];
        crowds->lower[e] = crowds->start[e] ? dgfemi_min3(crowds->lower[e], x) : x;
        crowds->upper[e] = crowds->start[e] ? dgfemi_max3(crowds->upper[e], x) : x;
        crowds->start[e]++;
    }
    for (int e = 0; e < element_count; e++) crowds->start[e + 1] += crowds->start[e]; /* filled from their ends */
    for (int p = embedding->point_count - 1; p >= 0; p--)
        crowds->point[--crowds->start[embedding->point_element[p]]] = p;
    return 1;
}

/* Clears `calm` for the points of one element that are disturbed. */
static void dgfemi_crowd_disturb(const dgfemi_crowds *crowds, const dgfemi_sampling *sampling, int element,
                                 const dgfemi_disturbance *disturbances, int count, char *calm) {
    const dgfem_embedding *embedding = sampling->embedding;
    dgfem_vec3 lower = crowds->lower[element], upper = crowds->upper[element];
    dgfem_real reach = dgfemi_sampling_reach(sampling, lower, upper);
    int left = 0;
    for (int i = crowds->start[element]; i < crowds->start[element + 1]; i++) left += calm[crowds->point[i]];
    for (int k = 0; left > 0 && k < count; k++) {
        const dgfemi_disturbance *d = &disturbances[k];
        dgfem_real limit = dgfemi_min(d->limit, reach), square = limit * limit;
        if (!(dgfemi_boxes_square(d->lower, d->upper, lower, upper) < square)) continue;
        for (int i = crowds->start[element]; i < crowds->start[element + 1]; i++) {
            int p = crowds->point[i];
            if (!calm[p] || !(dgfemi_box_square(d->lower, d->upper, embedding->point_window[p]) < square)) continue;
            calm[p] = 0;
            left--;
        }
    }
}

static void dgfemi_crowds_disturb(const dgfemi_crowds *crowds, const dgfemi_sampling *sampling,
                                  const dgfemi_disturbance *disturbances, int count, char *calm) {
    for (int e = 0; e < sampling->mesh->element_count; e++)
        if (crowds->start[e] < crowds->start[e + 1])
            dgfemi_crowd_disturb(crowds, sampling, e, disturbances, count, calm);
}

typedef struct dgfemi_reuse {
    const dgfem_embedding *old;
    dgfemi_kinship kinship;
    int *new_sample; /* [old samples] DGFEM_NONE: gone */
    char *known;     /* [samples] 1: an old one */
    char *keep;      /* [points] */
} dgfemi_reuse;

/* Notes what a later embedding compares with. 1 on success. */
static int dgfemi_embedding_sign(dgfem_embedding *embedding, const dgfemi_sampling *sampling) {
    const dgfem_mesh *mesh = sampling->mesh;
    const dgfem_hooks *hooks = &embedding->hooks;
    size_t elements = (size_t)mesh->element_count;
    embedding->sample_radius =
        (dgfem_real *)dgfemi_duplicate(hooks, sampling->radius, (size_t)embedding->sample_count, sizeof(dgfem_real));
    embedding->element_count = mesh->element_count;
    embedding->element_centre = (dgfem_vec3 *)dgfemi_allocate(hooks, elements, sizeof(dgfem_vec3));
    embedding->element_glue = (int *)dgfemi_allocate(hooks, elements, sizeof(int));
    embedding->element_box = (dgfem_vec3 *)dgfemi_allocate(hooks, 2 * elements, sizeof(dgfem_vec3));
    if (!embedding->sample_radius || !embedding->element_centre || !embedding->element_glue || !embedding->element_box)
        return 0;
    for (int e = 0; e < mesh->element_count; e++) {
        embedding->element_centre[e] = mesh->elements[e].centre;
        embedding->element_glue[e] = sampling->neighbour_start[e + 1] - sampling->neighbour_start[e];
        embedding->element_box[2 * e] = sampling->locator->lower[e];
        embedding->element_box[2 * e + 1] = sampling->locator->upper[e];
    }
    return 1;
}

/* Whether a sample has the same elements as an old one. */
static int dgfemi_reuse_same_terms(const dgfemi_reuse *reuse, const dgfem_embedding *embedding, int sample, int old) {
    const int *terms = embedding->term_start, *old_terms = reuse->old->term_start;
    if (terms[sample + 1] - terms[sample] != old_terms[old + 1] - old_terms[old]) return 0;
    for (int i = old_terms[old]; i < old_terms[old + 1]; i++) {
        int element = reuse->kinship.new_element[reuse->old->term_element[i]], found = 0;
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
    return 1;
}

/* Whether a point could keep its weights for all that it knows itself. */
static int dgfemi_reuse_is_same(const dgfemi_reuse *reuse, const dgfem_embedding *embedding, int point) {
    const dgfem_embedding *old = reuse->old;
    if (reuse->kinship.old_element[embedding->point_element[point]] != old->point_element[point]) return 0;
    if (!dgfemi_same_position(embedding->points[point], old->points[point])) return 0;
    if (!dgfemi_same_position(embedding->point_window[point], old->point_window[point])) return 0;
    for (int i = old->weight_start[point]; i < old->weight_start[point + 1]; i++)
        if (reuse->new_sample[old->weight_sample[i]] == DGFEM_NONE) return 0;
    return 1;
}

/* A sample of a changed element reaches no further than the element does. */
static int dgfemi_reuse_disturbs(const dgfemi_reuse *reuse, const dgfem_embedding *embedding, int sample) {
    if (reuse->known[sample]) return 0;
    for (int t = embedding->term_start[sample]; t < embedding->term_start[sample + 1]; t++)
        if (reuse->kinship.old_element[embedding->term_element[t]] == DGFEM_NONE) return 0;
    return 1;
}

/* Lets go of the weights that elements come or gone and new samples reach. Windows do not shrink: none of those that a
   kept point's weights come from reaches farther than windows do now. 1 on success, 0 when out of memory. */
static int dgfemi_reuse_disturb(dgfemi_arena *arena, dgfemi_reuse *reuse, const dgfemi_sampling *sampling,
                                const dgfemi_crowds *crowds) {
    const dgfem_embedding *old = reuse->old, *embedding = sampling->embedding;
    int elements = sampling->mesh->element_count, count = 0;
    size_t most = (size_t)elements + (size_t)old->element_count + (size_t)embedding->sample_count;
    dgfemi_disturbance *d = (dgfemi_disturbance *)dgfemi_arena_allocate(arena, most, sizeof *d);
    if (!d) return 0;
    for (int e = 0; e < elements; e++) {
        if (reuse->kinship.old_element[e] != DGFEM_NONE) continue;
        d[count].lower = sampling->locator->lower[e], d[count].upper = sampling->locator->upper[e];
        d[count++].limit = (dgfem_real)HUGE_VAL;
    }
    for (int e = 0; e < old->element_count; e++) {
        if (reuse->kinship.new_element[e] != DGFEM_NONE) continue;
        d[count].lower = old->element_box[2 * e], d[count].upper = old->element_box[2 * e + 1];
        d[count++].limit = (dgfem_real)HUGE_VAL;
    }
    for (int s = 0; s < embedding->sample_count; s++) {
        if (!dgfemi_reuse_disturbs(reuse, embedding, s)) continue;
        d[count].lower = d[count].upper = embedding->samples[s];
        d[count++].limit = sampling->radius[s];
    }
    dgfemi_crowds_disturb(crowds, sampling, d, count, reuse->keep);
    return 1;
}

/* Finds the samples that are the same. 1 on success. */
static int dgfemi_reuse_make(dgfemi_arena *arena, dgfemi_reuse *reuse, dgfemi_sampling *sampling) {
    dgfemi_buckets buckets;
    int ok;
    reuse->new_sample = (int *)dgfemi_arena_allocate(arena, (size_t)reuse->old->sample_count, sizeof(int));
    reuse->known = (char *)dgfemi_arena_allocate(arena, (size_t)sampling->embedding->sample_count, 1);
    if (!reuse->new_sample || !reuse->known) return 0;
    memset(&buckets, 0, sizeof buckets);
    ok = dgfemi_reuse_match_samples(reuse, sampling, &buckets);
    dgfemi_buckets_free(&sampling->embedding->hooks, &buckets);
    return ok;
}

/* ---- the embedding of points ---- */

/* Weights made anew, in the order in which they were. */
typedef struct dgfemi_weights {
    const dgfem_hooks *hooks;
    int *sample;
    dgfem_real *weight;
    int used, sample_capacity, weight_capacity;
    int *first, *count; /* [points] */
    char *open;         /* [points] 1: has no weights yet */
} dgfemi_weights;

/* The weights of a view's i-th point. 1 on success. */
static int dgfemi_weights_append(dgfemi_weights *weights, const dgfemi_view *view, int i) {
    int point = view->points[i], first = view->first[i], count = view->count[i], needed;
    if (count > INT_MAX - weights->used) return 0;
    needed = weights->used + count;
    if (needed > weights->sample_capacity) {
        void *grown = dgfemi_grow(weights->hooks, weights->sample, &weights->sample_capacity, needed, sizeof(int));
        if (!grown) return 0;
        weights->sample = (int *)grown;
    }
    if (needed > weights->weight_capacity) {
        void *grown =
            dgfemi_grow(weights->hooks, weights->weight, &weights->weight_capacity, needed, sizeof(dgfem_real));
        if (!grown) return 0;
        weights->weight = (dgfem_real *)grown;
    }
    memcpy(weights->sample + weights->used, view->seen_sample + first, (size_t)count * sizeof(int));
    memcpy(weights->weight + weights->used, view->weight + first, (size_t)count * sizeof(dgfem_real));
    weights->first[point] = weights->used, weights->count[point] = count;
    weights->open[point] = 0;
    weights->used = needed;
    return 1;
}

/* Views that are worked on at once, by as many threads as there are. */
enum { DGFEMI_VIEWS = 16 };

typedef struct dgfemi_round {
    dgfemi_weights *weights;
    dgfemi_viewer *viewer;
    int number;    /* how often windows have been enlarged */
    char *enlarge; /* [samples] 1: around points that are poorly served */
    int poor;      /* such points */
    dgfemi_arena arena;
    dgfemi_view views[DGFEMI_VIEWS];
    int view_count;
    int *list; /* [points] open ones, in the order of their elements */
} dgfemi_round;

static void dgfemi_round_range(void *context, int first, int last) {
    dgfemi_round *round = (dgfemi_round *)context;
    for (int i = first; i < last; i++) dgfemi_view_weigh_all(&round->views[i], round->number);
}

/* Marks the samples of the elements in view and of their neighbours. */
static void dgfemi_round_mark(dgfemi_round *round, const dgfemi_view *view) {
    const dgfemi_sampling *sampling = round->viewer->sampling;
    for (int i = 0; i < view->element_count; i++) {
        int e = view->element[i];
        for (int k = sampling->neighbour_start[e] - 1; k < sampling->neighbour_start[e + 1]; k++) {
            int element = k < sampling->neighbour_start[e] ? e : sampling->neighbour[k];
            for (int j = sampling->element_start[element]; j < sampling->element_start[element + 1]; j++)
                round->enlarge[sampling->element_sample[j]] = 1;
        }
    }
}

/* Weighs the points of all views. 1 on success. */
static int dgfemi_round_flush(dgfemi_round *round) {
    int ok = 1;
    dgfemi_parallel_for(round->weights->hooks, round->view_count, 1, dgfemi_round_range, round);
    for (int v = 0; v < round->view_count; v++) {
        const dgfemi_view *view = &round->views[v];
        int poor = 0;
        for (int i = 0; ok && i < view->point_count; i++) {
            if (view->count[i] == DGFEM_NONE) poor++;
            else ok = dgfemi_weights_append(round->weights, view, i);
        }
        if (poor > 0) dgfemi_round_mark(round, view);
        round->poor += poor;
    }
    dgfemi_arena_reuse(&round->arena);
    round->view_count = 0;
    return ok;
}

/* Weighs all open points that are well served, or, after the last enlargement, all. 1 on success. */
static int dgfemi_round_run(dgfemi_round *round, const dgfemi_crowds *crowds) {
    int ok = 1, used = 0;
    round->poor = round->view_count = 0;
    for (int e = 0; ok && e < round->viewer->sampling->mesh->element_count; e++) {
        int first = used;
        for (int i = crowds->start[e]; i < crowds->start[e + 1]; i++)
            if (round->weights->open[crowds->point[i]]) round->list[used++] = crowds->point[i];
        for (int count; ok && first < used; first += count) {
            count = used - first < DGFEM_VIEW_POINTS ? used - first : DGFEM_VIEW_POINTS;
            ok = dgfemi_view_make(&round->arena, round->viewer, e, round->list + first, count,
                                  &round->views[round->view_count++]);
            if (ok && round->view_count == DGFEMI_VIEWS) ok = dgfemi_round_flush(round);
        }
    }
    ok = ok && dgfemi_round_flush(round);
    dgfemi_arena_free(&round->arena);
    return ok;
}

/* Opens the points that enlarged windows reach; radius: what they were. */
static void dgfemi_weights_reopen(dgfemi_weights *weights, const dgfemi_sampling *sampling, const dgfemi_crowds *crowds,
                                  const dgfem_real *radius, dgfemi_disturbance *d, dgfemi_reuse *reuse, char *calm) {
    const dgfem_embedding *embedding = sampling->embedding;
    int count = 0;
    memset(calm, 1, (size_t)embedding->point_count);
    for (int s = 0; s < embedding->sample_count; s++) {
        if (!(sampling->radius[s] > radius[s])) continue;
        d[count].lower = d[count].upper = embedding->samples[s];
        d[count++].limit = sampling->radius[s];
    }
    dgfemi_crowds_disturb(crowds, sampling, d, count, calm);
    for (int p = 0; p < embedding->point_count; p++)
        if (!calm[p]) weights->open[p] = 1, reuse->keep[p] = 0;
}

/* Weighs all open points. Enlarges the windows of the samples around poorly served ones, once per round, until all are
   served; then points that the larger windows reach are weighed again. 1 on success. */
static int dgfemi_weights_make(dgfemi_arena *arena, dgfemi_weights *weights, dgfemi_sampling *sampling,
                               const dgfemi_crowds *crowds, dgfemi_reuse *reuse) {
    const dgfem_embedding *embedding = sampling->embedding;
    size_t samples = (size_t)embedding->sample_count, points = (size_t)embedding->point_count;
    dgfem_real *radius = (dgfem_real *)dgfemi_arena_allocate(arena, samples, sizeof(dgfem_real));
    dgfemi_disturbance *d = (dgfemi_disturbance *)dgfemi_arena_allocate(arena, samples, sizeof *d);
    dgfemi_round *round = (dgfemi_round *)dgfemi_arena_allocate_zero(arena, 1, sizeof *round);
    char *enlarge = (char *)dgfemi_arena_allocate(arena, samples, 1);
    char *calm = (char *)dgfemi_arena_allocate(arena, points, 1);
    int *list = (int *)dgfemi_arena_allocate(arena, points, sizeof(int));
    dgfemi_viewer viewer;
    if (!radius || !d || !round || !enlarge || !calm || !list) return 0;
    if (!dgfemi_viewer_make(arena, sampling, &viewer)) return 0;
    memcpy(radius, sampling->radius, samples * sizeof(dgfem_real));
    round->weights = weights, round->viewer = &viewer, round->enlarge = enlarge, round->list = list;
    round->arena = dgfemi_arena_make(weights->hooks);
    for (; round->number < DGFEM_MAX_ROUNDS; round->number++) {
        memset(enlarge, 0, samples);
        if (!dgfemi_round_run(round, crowds)) return 0;
        if (round->poor == 0) break;
        for (size_t s = 0; s < samples; s++)
            if (enlarge[s]) sampling->radius[s] *= DGFEM_ENLARGE;
        dgfemi_sampling_spread(sampling);
    }
    if (round->number == 0) return 1;
    dgfemi_weights_reopen(weights, sampling, crowds, radius, d, reuse, calm);
    round->number = DGFEM_MAX_ROUNDS;
    return dgfemi_round_run(round, crowds);
}

/* The old weights of a point, with the samples in ascending order again: most are already. */
static void dgfemi_reuse_weights(const dgfemi_reuse *reuse, int point, int *samples, dgfem_real *weights) {
    const dgfem_embedding *old = reuse->old;
    int first = old->weight_start[point], count = old->weight_start[point + 1] - first;
    for (int i = 0; i < count; i++) {
        int sample = reuse->new_sample[old->weight_sample[first + i]], j = i;
        for (; j > 0 && samples[j - 1] > sample; j--) samples[j] = samples[j - 1], weights[j] = weights[j - 1];
        samples[j] = sample, weights[j] = old->weight[first + i];
    }
}

/* All points' weights, kept or new, in the order of the points. 1 on success. */
static int dgfemi_embedding_gather(dgfem_embedding *embedding, const dgfemi_weights *weights,
                                   const dgfemi_reuse *reuse) {
    int total = 0;
    for (int p = 0; p < embedding->point_count; p++) {
        int count = reuse->keep[p] ? reuse->old->weight_start[p + 1] - reuse->old->weight_start[p] : weights->count[p];
        if (count > INT_MAX - total) return 0;
        embedding->weight_start[p] = total;
        total += count;
    }
    embedding->weight_start[embedding->point_count] = total;
    embedding->weight_sample = (int *)dgfemi_allocate(&embedding->hooks, (size_t)total, sizeof(int));
    embedding->weight = (dgfem_real *)dgfemi_allocate(&embedding->hooks, (size_t)total, sizeof(dgfem_real));
    if (!embedding->weight_sample || !embedding->weight) return 0;
    for (int p = 0; p < embedding->point_count; p++) {
        int *samples = embedding->weight_sample + embedding->weight_start[p];
        dgfem_real *values = embedding->weight + embedding->weight_start[p];
        if (reuse->keep[p]) {
            dgfemi_reuse_weights(reuse, p, samples, values);
            continue;
        }
        memcpy(samples, weights->sample + weights->first[p], (size_t)weights->count[p] * sizeof(int));
        memcpy(values, weights->weight + weights->first[p], (size_t)weights->count[p] * sizeof(dgfem_real));
    }
    return 1;
}

/* Weights of all points that do not keep theirs. 1 on success, 0 when out of memory. */
static int dgfemi_embedding_weigh(dgfemi_arena *arena, dgfem_embedding *embedding, dgfemi_sampling *sampling,
                                  dgfemi_reuse *reuse) {
    size_t points = (size_t)embedding->point_count;
    dgfemi_crowds crowds;
    dgfemi_weights weights;
    int ok;
    memset(&weights, 0, sizeof weights);
    weights.hooks = &embedding->hooks;
    weights.first = (int *)dgfemi_arena_allocate(arena, points, sizeof(int));
    weights.count = (int *)dgfemi_arena_allocate(arena, points, sizeof(int));
    weights.open = (char *)dgfemi_arena_allocate(arena, points, 1);
    if (!weights.first || !weights.count || !weights.open) return 0;
    if (!dgfemi_crowds_make(arena, embedding, sampling->mesh->element_count, &crowds)) return 0;
    if (reuse->old) {
        for (int p = 0; p < embedding->point_count && p < reuse->old->point_count; p++)
            reuse->keep[p] = (char)dgfemi_reuse_is_same(reuse, embedding, p);
        if (!dgfemi_reuse_disturb(arena, reuse, sampling, &crowds)) return 0;
    }
    for (int p = 0; p < embedding->point_count; p++) weights.open[p] = !reuse->keep[p];
    ok = dgfemi_weights_make(arena, &weights, sampling, &crowds, reuse) &&
         dgfemi_embedding_gather(embedding, &weights, reuse);
    dgfemi_free(&embedding->hooks, weights.sample);
    dgfemi_free(&embedding->hooks, weights.weight);
    return ok;
}

/* Reads the points. DGFEM_ERROR_NOT_FINITE names the first bad one. */
static dgfem_status dgfemi_embedding_read_points(dgfem_embedding *embedding, const dgfem_points_in *points) {
    embedding->point_count = points->count;
    embedding->points = (dgfem_vec3 *)dgfemi_allocate(&embedding->hooks, (size_t)points->count, sizeof(dgfem_vec3));
    embedding->point_element = (int *)dgfemi_allocate(&embedding->hooks, (size_t)points->count, sizeof(int));
    embedding->point_window =
        (dgfem_vec3 *)dgfemi_allocate(&embedding->hooks, (size_t)points->count, sizeof(dgfem_vec3));
    embedding->weight_start = (int *)dgfemi_allocate_zero(&embedding->hooks, (size_t)points->count + 1, sizeof(int));
    if (!embedding->points || !embedding->point_element || !embedding->point_window || !embedding->weight_start)
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

/* Samples, places and weights, with temporary memory from the arena. `places` may be NULL: found from `anchors`, as in
   dgfemi_places_find. `old`, of the same first points before the body's topology changed, may be NULL. 1 on success, 0
   when out of memory. */
static int dgfemi_embedding_build(dgfemi_arena *arena, const dgfem_body *body, const dgfem_corners *corners,
                                  const dgfem_vec3 *anchors, const dgfemi_places *places, const dgfem_embedding *old,
                                  dgfem_embedding *embedding) {
    size_t points = (size_t)embedding->point_count;
    dgfemi_locator locator;
    dgfemi_places found;
    dgfemi_reuse reuse;
    dgfemi_sampling sampling;
    memset(&reuse, 0, sizeof reuse);
    reuse.old = old;
    reuse.keep = (char *)dgfemi_arena_allocate_zero(arena, points, 1);
    if (places) found = *places;
    else if (!dgfemi_locator_make(arena, body->mesh, &locator) ||
             !dgfemi_places_allocate(arena, embedding->point_count, &locator, &found))
        return 0;
    if (!reuse.keep || !dgfemi_embedding_choose_samples(arena, embedding, body, corners) ||
        !dgfemi_sampling_make(arena, body->mesh, embedding, found.locator, &sampling) ||
        (old && !dgfemi_kinship_make(arena, body->mesh, old, &reuse.kinship)) ||
        (old && !dgfemi_reuse_make(arena, &reuse, &sampling)))
        return 0;
    if (!places)
        dgfemi_places_find(embedding->points, anchors, embedding->point_count, old, &reuse.kinship, &found);
    if (points > 0) {
        memcpy(embedding->point_element, found.element, points * sizeof(int));
        memcpy(embedding->point_window, found.window, points * sizeof(dgfem_vec3));
    }
    dgfemi_sampling_spread(&sampling);
    return dgfemi_embedding_weigh(arena, embedding, &sampling, &reuse) &&
           dgfemi_embedding_sign(embedding, &sampling);
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
    dgfemi_free(&hooks, embedding->point_window);
    dgfemi_free(&hooks, embedding->weight_start);
    dgfemi_free(&hooks, embedding->weight_sample);
    dgfemi_free(&hooks, embedding->weight);
    dgfemi_free(&hooks, embedding->sample_radius);
    dgfemi_free(&hooks, embedding->element_centre);
    dgfemi_free(&hooks, embedding->element_glue);
    dgfemi_free(&hooks, embedding->element_box);
    dgfemi_free(&hooks, embedding);
}

static dgfem_embedding *dgfemi_embedding_new(const dgfem_body *body, const dgfem_hooks *hooks) {
    dgfem_embedding *embedding = (dgfem_embedding *)dgfemi_allocate_zero(hooks, 1, sizeof *embedding);
    if (!embedding) return NULL;
    embedding->hooks = *hooks;
    embedding->revision = body->revision;
    return embedding;
}

/* anchors, places and old as in dgfemi_embedding_build. */
static dgfem_status dgfemi_embedding_create_at(const dgfem_body *body, const dgfem_points_in *points,
                                               const dgfem_vec3 *anchors, const dgfemi_places *places,
                                               const dgfem_embedding *old, const dgfem_hooks *hooks,
                                               dgfem_embedding **out) {
    dgfem_embedding *embedding = dgfemi_embedding_new(body, hooks);
    dgfem_corners *corners = NULL;
    dgfemi_arena arena = dgfemi_arena_make(hooks);
    dgfem_status status;
    if (!embedding) return dgfemi_fail_memory(hooks);
    status = dgfemi_embedding_read_points(embedding, points);
    if (status == DGFEM_OK) status = dgfem_mesh_corners(body->mesh, &corners);
    if (status == DGFEM_OK && !dgfemi_embedding_build(&arena, body, corners, anchors, places, old, embedding))
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
    return dgfemi_embedding_create_at(body, points, NULL, NULL, NULL, hooks, out);
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
