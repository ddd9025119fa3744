#pragma once
#include "embed.c"
/* Embedding of points, second part: weights. Points that sit in one element see much the same. What they may see - the
   elements around and the samples whose windows reach that far - is listed once for some of them, in a view; then each
   point's weights are computed from its view alone, by any thread. */

#define DGFEM_ENLARGE DGFEM_R(1.25)
#define DGFEM_MIN_POINT_SAMPLES 8
#define DGFEM_MAX_CONDITION DGFEM_R(1e4) /* of C; a larger one enlarges the windows */
#define DGFEM_CONDITION_ROUNDS 4         /* but only so often: a thin plate has no better one to offer */
#define DGFEM_MAX_ROUNDS 64
#define DGFEM_VIEW_POINTS 32 /* at most: it bounds a view's memory */

typedef struct dgfemi_view {
    const dgfem_embedding *embedding;
    const int *points; /* of one element */
    int point_count, home;
    int element_count; /* elements that may have to be passed, each beside an earlier one; the first is the home */
    int *element, *neighbour_start, *neighbour; /* glued neighbours, as places in this list */
    dgfem_real *box[6];                         /* their boxes: lower x, y, z, upper x, y, z */
    char *straight;                             /* [elements] 1: no point's way there is longer than it must be */
    int sample_count;                           /* samples that may be seen, ascending */
    int *sample, *term_start, *term;            /* their elements, as places in the list */
    char *plain;                                /* [samples] 1: lies in the box of a straight element */
    dgfem_real *at[3], *square;                 /* their positions and R_k^2 */
    int all;                                    /* samples that are connected to the home */
    int *first, *count;                         /* [points] results; count DGFEM_NONE: poorly served */
    int *seen_sample;                           /* [point_count * sample_count] one point's after another's */
    dgfem_real *weight;
    int *blocked; /* room for one point: [elements], */
    dgfem_real *near, *way; /* squared distance of its box; of the farthest box that must be passed to get there */
    int *pick; /* and [samples] those that reach the point, */
    dgfem_real *distance, *theta, *offset[3]; /* squared distance; window; from the point to the sample */
} dgfemi_view;

/* Lists below are filled without branches: what to keep is hard to predict, and what is not is overwritten. */

/* ---- what can be seen ---- */

/* Makes views. All arrays have one place for each element or sample. */
typedef struct dgfemi_viewer {
    const dgfemi_sampling *sampling;
    int *mark, stamp; /* search that met the element last */
    int *place;       /* in the list of the view being made */
    int *element, *sample, *spare;
} dgfemi_viewer;

/* 1 on success, 0 when out of memory. */
static int dgfemi_viewer_make(dgfemi_arena *arena, const dgfemi_sampling *sampling, dgfemi_viewer *viewer) {
    size_t elements = (size_t)sampling->mesh->element_count, samples = (size_t)sampling->embedding->sample_count;
    viewer->sampling = sampling, viewer->stamp = 0;
    viewer->mark = (int *)dgfemi_arena_allocate_zero(arena, elements, sizeof(int));
    viewer->place = (int *)dgfemi_arena_allocate(arena, elements, sizeof(int));
    viewer->element = (int *)dgfemi_arena_allocate(arena, elements, sizeof(int));
    viewer->sample = (int *)dgfemi_arena_allocate(arena, samples, sizeof(int));
    viewer->spare = (int *)dgfemi_arena_allocate(arena, samples, sizeof(int));
    return viewer->mark && viewer->place && viewer->element && viewer->sample && viewer->spare;
}

/* Lists the elements that hang together with `home` within `reach` of a box. Returns their number. */
static int dgfemi_viewer_find_elements(dgfemi_viewer *viewer, int home, dgfem_vec3 lower, dgfem_vec3 upper,
                                       dgfem_real reach) {
    const dgfemi_sampling *sampling = viewer->sampling;
    const dgfemi_locator *locator = sampling->locator;
    int count = 1;
    viewer->stamp++;
    viewer->element[0] = home, viewer->mark[home] = viewer->stamp, viewer->place[home] = 0;
    for (int i = 0; i < count; i++) {
        int e = viewer->element[i];
        for (int k = sampling->neighbour_start[e]; k < sampling->neighbour_start[e + 1]; k++) {
            int other = sampling->neighbour[k];
            if (viewer->mark[other] == viewer->stamp) continue;
            viewer->mark[other] = viewer->stamp, viewer->place[other] = DGFEM_NONE;
            if (!(dgfemi_boxes_square(locator->lower[other], locator->upper[other], lower, upper) < reach * reach))
                continue;
            viewer->place[other] = count;
            viewer->element[count++] = other;
        }
    }
    return count;
}

#define DGFEM_DIGIT 6 /* bits */

/* Sorts the list of samples: some hundred of thousands, by their digits, the lowest first. */
static void dgfemi_viewer_sort(dgfemi_viewer *viewer, int count) {
    const int digits = 1 << DGFEM_DIGIT;
    for (int shift = 0; viewer->sampling->embedding->sample_count >> shift > 0; shift += DGFEM_DIGIT) {
        int start[1 << DGFEM_DIGIT] = {0}, total = 0, *sample = viewer->sample;
        for (int i = 0; i < count; i++) start[sample[i] >> shift & (digits - 1)]++;
        for (int d = 0; d < digits; d++) {
            int size = start[d];
            start[d] = total;
            total += size;
        }
        for (int i = 0; i < count; i++) viewer->spare[start[sample[i] >> shift & (digits - 1)]++] = sample[i];
        viewer->sample = viewer->spare, viewer->spare = sample;
    }
}

/* Lists the samples of the listed elements whose windows touch the box. A sample lies in the boxes of all its elements:
   if it does, the first one of them is listed. Returns their number. */
static int dgfemi_viewer_find_samples(dgfemi_viewer *viewer, int element_count, dgfem_vec3 lower, dgfem_vec3 upper) {
    const dgfemi_sampling *sampling = viewer->sampling;
    int count = 0;
    for (int i = 0; i < element_count; i++) {
        int e = viewer->element[i];
        for (int k = sampling->element_start[e]; k < sampling->element_start[e + 1]; k++) {
            int s = sampling->element_sample[k];
            dgfem_real square = dgfemi_box_square(lower, upper, sampling->embedding->samples[s]);
            viewer->sample[count] = s;
            count += square < sampling->radius[s] * sampling->radius[s];
        }
    }
    dgfemi_viewer_sort(viewer, count);
    return count;
}

/* Room for the lists that the viewer holds, for the results and for work. 1 on success. */
static int dgfemi_view_allocate(dgfemi_arena *arena, const dgfemi_viewer *viewer, dgfemi_view *view) {
    const dgfemi_sampling *sampling = viewer->sampling;
    const int *term_start = sampling->embedding->term_start;
    size_t elements = (size_t)view->element_count, samples = (size_t)view->sample_count;
    size_t points = (size_t)view->point_count, neighbours = 0, terms = 0;
    dgfem_real *reals;
    int *ints;
    char *chars = (char *)dgfemi_arena_allocate(arena, elements + samples, 1);
    for (size_t i = 0; i < elements; i++)
        neighbours += (size_t)(sampling->neighbour_start[viewer->element[i] + 1] -
                               sampling->neighbour_start[viewer->element[i]]);
    for (size_t i = 0; i < samples; i++)
        terms += (size_t)(term_start[viewer->sample[i] + 1] - term_start[viewer->sample[i]]);
    reals = (dgfem_real *)dgfemi_arena_allocate(arena, 8 * elements + (9 + points) * samples, sizeof *reals);
    ints = (int *)dgfemi_arena_allocate(
        arena, 3 * elements + 1 + neighbours + (3 + points) * samples + 1 + terms + 2 * points, sizeof *ints);
    if (!reals || !ints || !chars) return 0;
    view->straight = chars, view->plain = chars + elements;
    for (int axis = 0; axis < 6; axis++) view->box[axis] = reals, reals += elements;
    view->near = reals, reals += elements;
    view->way = reals, reals += elements;
    for (int axis = 0; axis < 3; axis++) {
        view->at[axis] = reals, reals += samples;
        view->offset[axis] = reals, reals += samples;
    }
    view->square = reals, reals += samples;
    view->distance = reals, reals += samples;
    view->theta = reals, reals += samples;
    view->weight = reals;
    view->element = ints, ints += elements;
    view->blocked = ints, ints += elements;
    view->neighbour_start = ints, ints += elements + 1;
    view->neighbour = ints, ints += neighbours;
    view->sample = ints, ints += samples;
    view->pick = ints, ints += samples;
    view->term_start = ints, ints += samples + 1;
    view->term = ints, ints += terms;
    view->first = ints, ints += points;
    view->count = ints, ints += points;
    view->seen_sample = ints;
    return 1;
}

/* Whether box j is no farther than box i from any point between a and b: along each axis it reaches as far towards the
   points, or to all of them. */
static int dgfemi_view_is_nearer(const dgfemi_view *view, int j, int i, dgfem_vec3 a, dgfem_vec3 b) {
    for (int axis = 0; axis < 3; axis++) {
        const dgfem_real *lower = view->box[axis], *upper = view->box[3 + axis];
        if (lower[j] > lower[i] && lower[j] > dgfemi_axis(a, axis)) return 0;
        if (upper[j] < upper[i] && upper[j] < dgfemi_axis(b, axis)) return 0;
    }
    return 1;
}

/* Fills `straight`, seen from between a and b: reached through straight elements that are nearer. */
static void dgfemi_view_find_straight(dgfemi_view *view, dgfem_vec3 a, dgfem_vec3 b) {
    view->straight[0] = 1;
    for (int i = 1; i < view->element_count; i++) {
        view->straight[i] = 0;
        for (int k = view->neighbour_start[i]; !view->straight[i] && k < view->neighbour_start[i + 1]; k++) {
            int j = view->neighbour[k];
            view->straight[i] = j < i && view->straight[j] && dgfemi_view_is_nearer(view, j, i, a, b);
        }
    }
}

static void dgfemi_view_fill_elements(const dgfemi_viewer *viewer, dgfemi_view *view) {
    const dgfemi_sampling *sampling = viewer->sampling;
    int total = 0;
    for (int i = 0; i < view->element_count; i++) {
        int e = viewer->element[i];
        dgfem_vec3 lower = sampling->locator->lower[e], upper = sampling->locator->upper[e];
        view->element[i] = e, view->neighbour_start[i] = total;
        view->box[0][i] = lower.x, view->box[1][i] = lower.y, view->box[2][i] = lower.z;
        view->box[3][i] = upper.x, view->box[4][i] = upper.y, view->box[5][i] = upper.z;
        for (int k = sampling->neighbour_start[e]; k < sampling->neighbour_start[e + 1]; k++) {
            view->neighbour[total] = viewer->place[sampling->neighbour[k]];
            total += view->neighbour[total] != DGFEM_NONE;
        }
    }
    view->neighbour_start[view->element_count] = total;
}

static void dgfemi_view_fill_samples(const dgfemi_viewer *viewer, dgfemi_view *view) {
    const dgfemi_sampling *sampling = viewer->sampling;
    const dgfem_embedding *embedding = sampling->embedding;
    int total = 0;
    for (int i = 0; i < view->sample_count; i++) {
        int s = viewer->sample[i];
        dgfem_vec3 x = embedding->samples[s];
        view->sample[i] = s, view->term_start[i] = total, view->plain[i] = 0;
        view->at[0][i] = x.x, view->at[1][i] = x.y, view->at[2][i] = x.z;
        view->square[i] = sampling->radius[s] * sampling->radius[s];
        for (int t = embedding->term_start[s]; t < embedding->term_start[s + 1]; t++) {
            int e = embedding->term_element[t];
            int place = viewer->mark[e] == viewer->stamp ? viewer->place[e] : DGFEM_NONE;
            if (place == DGFEM_NONE) continue;
            view->term[total++] = place;
            if (view->straight[place] && !view->plain[i]) /* corners lie in the box; round-off may move a centre out */
                view->plain[i] = s >= sampling->mesh->element_count ||
                                 !(dgfemi_box_square(sampling->locator->lower[e], sampling->locator->upper[e], x) > 0);
        }
    }
    view->term_start[view->sample_count] = total;
}

/* What points[point_count], all of the element `home`, may see. 1 on success, 0 when out of memory. */
static int dgfemi_view_make(dgfemi_arena *arena, dgfemi_viewer *viewer, int home, const int *points, int point_count,
                            dgfemi_view *view) {
    const dgfemi_sampling *sampling = viewer->sampling;
    const dgfem_embedding *embedding = sampling->embedding;
    dgfem_vec3 lower = embedding->point_window[points[0]], upper = lower;
    for (int i = 1; i < point_count; i++) {
        lower = dgfemi_min3(lower, embedding->point_window[points[i]]);
        upper = dgfemi_max3(upper, embedding->point_window[points[i]]);
    }
    view->embedding = embedding, view->points = points, view->point_count = point_count, view->home = home;
    view->all = sampling->component_samples[sampling->component[home]];
    view->element_count =
        dgfemi_viewer_find_elements(viewer, home, lower, upper, dgfemi_sampling_reach(sampling, lower, upper));
    view->sample_count = dgfemi_viewer_find_samples(viewer, view->element_count, lower, upper);
    if (!dgfemi_view_allocate(arena, viewer, view)) return 0;
    dgfemi_view_fill_elements(viewer, view);
    dgfemi_view_find_straight(view, lower, upper);
    dgfemi_view_fill_samples(viewer, view);
    return 1;
}

/* ---- the samples that reach a point ---- */

/* The way to an element by those of its neighbours. */
static dgfem_real dgfemi_view_way(const dgfemi_view *view, int i) {
    dgfem_real shortest = view->way[view->neighbour[view->neighbour_start[i]]];
    for (int k = view->neighbour_start[i] + 1; k < view->neighbour_start[i + 1] && shortest > view->near[i]; k++)
        shortest = dgfemi_min(shortest, view->way[view->neighbour[k]]);
    return dgfemi_max(shortest, view->near[i]);
}

/* Fills `near` and `way`. Most ways are no longer than they must be, as to straight elements or as a neighbour's is;
   the others (`blocked`) are shortened as long as a neighbour's way has been. */
static void dgfemi_view_find_ways(dgfemi_view *view, dgfem_vec3 x) {
    int blocked = 0, shortened = 1;
    for (int i = 0; i < view->element_count; i++) {
        dgfem_real dx = dgfemi_max(dgfemi_max(view->box[0][i] - x.x, x.x - view->box[3][i]), 0);
        dgfem_real dy = dgfemi_max(dgfemi_max(view->box[1][i] - x.y, x.y - view->box[4][i]), 0);
        dgfem_real dz = dgfemi_max(dgfemi_max(view->box[2][i] - x.z, x.z - view->box[5][i]), 0);
        view->near[i] = dx * dx + dy * dy + dz * dz;
        view->way[i] = (dgfem_real)HUGE_VAL;
    }
    view->way[0] = 0;
    for (int i = 1; i < view->element_count; i++) {
        view->way[i] = view->straight[i] ? view->near[i] : dgfemi_view_way(view, i);
        if (view->way[i] > view->near[i]) view->blocked[blocked++] = i;
    }
    while (shortened) {
        shortened = 0;
        for (int k = 0; k < blocked; k++) {
            int i = view->blocked[k];
            dgfem_real way = dgfemi_view_way(view, i);
            if (!(way < view->way[i])) continue;
            view->way[i] = way, shortened = 1;
        }
    }
}

/* exp(-2 s), 0 <= s <= 1: a sixteenth of the exponent by its series, squared four times. */
static dgfem_real dgfemi_window_exp(dgfem_real s) {
    const dgfem_real third = DGFEM_R(1.) / 3, fifth = DGFEM_R(1.) / 5, sixth = DGFEM_R(1.) / 6;
    const dgfem_real seventh = DGFEM_R(1.) / 7, ninth = DGFEM_R(1.) / 9;
    dgfem_real t = s * DGFEM_R(-0.125), e = 1 + t * ninth;
    e = 1 + t * DGFEM_R(0.125) * e;
    e = 1 + t * seventh * e;
    e = 1 + t * sixth * e;
    e = 1 + t * fifth * e;
    e = 1 + t * DGFEM_R(0.25) * e;
    e = 1 + t * third * e;
    e = 1 + t * DGFEM_R(0.5) * e;
    e = 1 + t * e;
    e *= e, e *= e, e *= e;
    return e * e;
}

/* Fills `pick` and `theta`, relative to the largest, so that far samples alone do as well as near ones. To a plain
   sample no way is longer than its distance; where all are plain, ways are not looked for. Returns the number of
   samples that reach x. */
static int dgfemi_view_find_seen(dgfemi_view *view, dgfem_vec3 x) {
    dgfem_real largest = 0;
    int near = 0, count = 0, plain = 1;
    for (int k = 0; k < view->sample_count; k++) {
        dgfem_real dx = view->at[0][k] - x.x, dy = view->at[1][k] - x.y, dz = view->at[2][k] - x.z;
        view->distance[k] = dx * dx + dy * dy + dz * dz;
    }
    for (int k = 0; k < view->sample_count; k++) {
        view->pick[near] = k;
        near += view->distance[k] < view->square[k];
    }
    for (int i = 0; i < near; i++) plain &= view->plain[view->pick[i]];
    if (!plain) dgfemi_view_find_ways(view, x);
    for (int i = 0; i < near; i++) {
        int k = view->pick[i];
        dgfem_real s, way = view->plain[k] ? 0 : view->way[view->term[view->term_start[k]]];
        for (int t = view->term_start[k] + 1; t < view->term_start[k + 1] && way > view->distance[k]; t++)
            way = dgfemi_min(way, view->way[view->term[t]]);
        s = dgfemi_max(way, view->distance[k]) / view->square[k];
        if (!(s < 1)) continue;
        view->pick[count] = k, view->theta[count++] = s;
    }
    for (int i = 0; i < count; i++) {
        dgfem_real s = view->theta[i], rest = 1 - s;
        view->theta[i] = dgfemi_window_exp(s) * rest * rest * rest;
    }
    for (int i = 0; i < count; i++) largest = dgfemi_max(largest, view->theta[i]);
    for (int i = 0; i < count; i++) view->theta[i] /= largest;
    return count;
}

/* All samples of the home, alike. Returns their number. */
static int dgfemi_view_take_home(dgfemi_view *view) {
    int count = 0;
    for (int k = 0; k < view->sample_count; k++)
        for (int t = view->term_start[k]; t < view->term_start[k + 1]; t++)
            if (view->term[t] == 0) view->pick[count] = k, view->theta[count++] = 1;
    return count;
}

/* ---- weights ---- */

/* Weighted means of the samples that reach x, relative to x. */
typedef struct dgfemi_fit {
    dgfem_real weight; /* W */
    dgfem_vec3 mean;   /* m - x */
    dgfem_mat3 inverse; /* C^-1; directions in which the samples do not spread are left out of it */
    int is_conditioned, is_flat;
} dgfemi_fit;

#define DGFEM_FLAT                                                                                                     \
    (DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-6) : DGFEM_R(1e-12)) /* of the largest moment: smaller is round-off */
#define DGFEM_ROUND DGFEM_R(1e-3) /* smallest by largest moment: the inverse by cofactors is good enough */

/* Fills `offset`, from x to the first `count` picks. */
static void dgfemi_view_set_offsets(dgfemi_view *view, int count, dgfem_vec3 x) {
    for (int i = 0; i < count; i++) {
        int k = view->pick[i];
        view->offset[0][i] = view->at[0][k] - x.x;
        view->offset[1][i] = view->at[1][k] - x.y;
        view->offset[2][i] = view->at[2][k] - x.z;
    }
}

/* sum theta d d^T, d the offset from the mean. */
static dgfem_mat3 dgfemi_view_moments(const dgfemi_view *view, int count, dgfem_vec3 mean) {
    dgfem_real xx = 0, yy = 0, zz = 0, xy = 0, xz = 0, yz = 0;
    dgfem_mat3 c;
    for (int i = 0; i < count; i++) {
        dgfem_real x = view->offset[0][i] - mean.x, y = view->offset[1][i] - mean.y, z = view->offset[2][i] - mean.z;
        dgfem_real tx = view->theta[i] * x, ty = view->theta[i] * y, tz = view->theta[i] * z;
        xx += tx * x, yy += ty * y, zz += tz * z;
        xy += tx * y, xz += tx * z, yz += ty * z;
    }
    c.m[0][0] = xx, c.m[1][1] = yy, c.m[2][2] = zz;
    c.m[0][1] = c.m[1][0] = xy, c.m[0][2] = c.m[2][0] = xz, c.m[1][2] = c.m[2][1] = yz;
    return c;
}

/* Inverts C. With eigenvalues a <= b <= c and trace t, det = abc <= a t^2/4: a/c is at least 4 det/t^3. Where
   that is large the cofactors do, else the eigenvectors. */
static void dgfemi_fit_invert(dgfemi_fit *fit, const dgfem_mat3 *c) {
    dgfem_vec3 x = dgfemi_column(c, 0), y = dgfemi_column(c, 1), z = dgfemi_column(c, 2);
    dgfem_real trace = x.x + y.y + z.z, determinant = dgfemi_determinant(c), moment[3];
    dgfem_mat3 axes;
    fit->is_conditioned = 1, fit->is_flat = 0;
    if (4 * determinant > DGFEM_ROUND * trace * trace * trace) {
        dgfemi_set_column(&fit->inverse, 0, dgfemi_scale(1 / determinant, dgfemi_cross(y, z)));
        dgfemi_set_column(&fit->inverse, 1, dgfemi_scale(1 / determinant, dgfemi_cross(z, x)));
        dgfemi_set_column(&fit->inverse, 2, dgfemi_scale(1 / determinant, dgfemi_cross(x, y)));
        return;
    }
    dgfem_eigen_symmetric(*c, moment, &axes);
    memset(&fit->inverse, 0, sizeof fit->inverse);
    for (int i = 0; i < 3; i++) {
        dgfem_vec3 axis = dgfemi_column(&axes, i);
        if (moment[i] > DGFEM_FLAT * moment[2]) dgfemi_add_outer(&fit->inverse, 1 / moment[i], axis, axis);
        else fit->is_flat = 1;
    }
    fit->is_conditioned = moment[0] * DGFEM_MAX_CONDITION > moment[2];
}

static void dgfemi_view_fit(const dgfemi_view *view, int count, dgfemi_fit *fit) {
    dgfem_real w = 0, x = 0, y = 0, z = 0;
    dgfem_mat3 c;
    for (int i = 0; i < count; i++) {
        dgfem_real theta = view->theta[i];
        w += theta, x += theta * view->offset[0][i], y += theta * view->offset[1][i], z += theta * view->offset[2][i];
    }
    fit->weight = w, fit->mean = dgfemi_vec3(x / w, y / w, z / w);
    c = dgfemi_view_moments(view, count, fit->mean);
    dgfemi_fit_invert(fit, &c);
}

/* Adds theta_k (value / W + (x_k - m)^T C^-1 slope) to the weights: sum phi grows by `value`, and sum phi (x_k - m) by
   `slope`. */
static void dgfemi_view_add_weights(const dgfemi_view *view, int count, const dgfemi_fit *fit, dgfem_real value,
                                    dgfem_vec3 slope, dgfem_real *weight) {
    dgfem_vec3 s = dgfemi_multiply(&fit->inverse, slope);
    dgfem_real constant = value / fit->weight - dgfemi_dot(s, fit->mean);
    for (int i = 0; i < count; i++)
        weight[i] += view->theta[i] * (constant + s.x * view->offset[0][i] + s.y * view->offset[1][i] +
                                       s.z * view->offset[2][i]);
}

/* Weights from the windows in theta. What round-off has left of sum phi = 1 and sum phi (x_k - x) = 0 is put right by
   the same formula. */
static void dgfemi_view_set_weights(const dgfemi_view *view, int count, const dgfemi_fit *fit, dgfem_real *weight) {
    dgfem_real sum = 0, x = 0, y = 0, z = 0;
    for (int i = 0; i < count; i++) weight[i] = 0;
    dgfemi_view_add_weights(view, count, fit, 1, dgfemi_scale(-1, fit->mean), weight);
    for (int i = 0; i < count; i++) {
        dgfem_real w = weight[i];
        sum += w, x += w * view->offset[0][i], y += w * view->offset[1][i], z += w * view->offset[2][i];
    }
    dgfemi_view_add_weights(view, count, fit, 1 - sum,
                            dgfemi_add_scaled(dgfemi_vec3(-x, -y, -z), -(1 - sum), fit->mean), weight);
}

/* Weights of a point, from `first` on of the results, if the samples that reach it, `round` enlargements on, determine
   the fit. Returns their number, or DGFEM_NONE. */
static int dgfemi_view_weigh(dgfemi_view *view, int point, int first, int round) {
    dgfem_vec3 x = view->embedding->points[point];
    dgfemi_fit fit;
    int count, found;
    count = dgfemi_view_find_seen(view, view->embedding->point_window[point]);
    found = round >= DGFEM_MAX_ROUNDS || count == view->all; /* there are no more */
    if (!found && count < DGFEM_MIN_POINT_SAMPLES) return DGFEM_NONE;
    dgfemi_view_set_offsets(view, count, x);
    dgfemi_view_fit(view, count, &fit);
    if (!found && round < DGFEM_CONDITION_ROUNDS && !fit.is_conditioned) return DGFEM_NONE;
    if (fit.is_flat) {
        count = dgfemi_view_take_home(view);
        dgfemi_view_set_offsets(view, count, x);
        dgfemi_view_fit(view, count, &fit);
    }
    dgfemi_view_set_weights(view, count, &fit, view->weight + first);
    for (int i = 0; i < count; i++) view->seen_sample[first + i] = view->sample[view->pick[i]];
    return count;
}

/* An earlier point of the view in the same place, as vertices on a seam or at a cut are; else DGFEM_NONE. */
static int dgfemi_view_find_double(const dgfemi_view *view, int i) {
    const dgfem_embedding *embedding = view->embedding;
    for (int j = 0; j < i; j++)
        if (dgfemi_same_position(embedding->point_window[view->points[i]], embedding->point_window[view->points[j]]) &&
            dgfemi_same_position(embedding->points[view->points[i]], embedding->points[view->points[j]]))
            return j;
    return DGFEM_NONE;
}

static void dgfemi_view_weigh_all(dgfemi_view *view, int round) {
    int used = 0;
    for (int i = 0; i < view->point_count; i++) {
        int j = dgfemi_view_find_double(view, i);
        view->first[i] = j == DGFEM_NONE ? used : view->first[j];
        view->count[i] =
            j == DGFEM_NONE ? dgfemi_view_weigh(view, view->points[i], used, round) : view->count[j];
        if (j == DGFEM_NONE && view->count[i] != DGFEM_NONE) used += view->count[i];
    }
}
