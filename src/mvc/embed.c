#pragma once
#include "locate.c"
/* Embedding of points by moving least squares (MLS) over the nodes.

   A point's displacement is the value at x of the affine function that fits the nodes' displacements best in the sense
   of
     sum_k theta_k |a(x_k) - u_k|^2,   theta = exp(-2 q^2) (1 - q^2)^3,   q = |x - x_k| / R_k < 1,
   a window that is C2 at its edge. In terms of weighted means (W = sum theta_k, m = sum theta_k x_k / W,
   C = sum theta_k (x_k - m)(x_k - m)^T) the weight of node k is
     phi_k(x) = theta_k (1/W + (x_k - m)^T C^-1 (x - m)),   sum phi_k = 1,   sum phi_k x_k = x.
   R_k is 1.5 times the distance of the node from the farthest node of its elements: so windows of the nodes of an
   element reach all of it, with room for points a little outside.

   A node reaches a point only through elements that hang together by faces. Where the straight way is blocked, by a cut
   or between two ears, the distance to the elements that have to be passed counts instead,
     q = max(|x - x_k|, least over the ways of the greatest distance from x to an element on it) / R_k,
   so that weights vanish continuously. */

#define DGFEM_MVCI_REACH DGFEM_R(1.5)
#define DGFEM_MVCI_OUTSIDE DGFEM_R(0.2) /* windows are taken this part of an element's radius outside at most */

typedef struct dgfem_mvci_mls {
    dgfem_real *radius; /* [nodes] R_k */
    dgfem_real largest; /* of these */
    int vertex;         /* number of the point at hand; where the marks are equal to it: */
    int *element_mark;  /* [elements] the next two are known: */
    dgfem_real *away;   /*   distance from the point */
    dgfem_real *path;   /*   least over the ways here of the greatest distance on it */
    char *queued;       /* [elements] 1: stands in the queue */
    int *queue;         /* [elements] a ring */
    int *touched;       /* [elements] those that are marked */
    int *node_mark;     /* [nodes] the node is in `samples`, */
    dgfem_real *ways;   /*   this is the least `path` of its elements */
    int *samples;       /* [nodes] */
    dgfem_real *theta;  /* [nodes] of the samples */
} dgfem_mvci_mls;

/* Windows' radii. */
static void dgfem_mvci_mls_measure(const dgfem_mvc *body, dgfem_mvci_mls *mls) {
    const dgfem_mvc_system *system = body->system;
    for (int e = 0; e < body->element_count; e++)
        for (int i = system->node_start[e]; i < system->node_start[e + 1]; i++)
            for (int j = system->node_start[e]; j < system->node_start[e + 1]; j++) {
                dgfem_real distance =
                    DGFEM_MVCI_REACH * dgfem_mvci_distance(body->rest[system->nodes[i]], body->rest[system->nodes[j]]);
                dgfem_real *radius = &mls->radius[system->nodes[i]];
                *radius = dgfem_mvci_max(*radius, distance);
                mls->largest = dgfem_mvci_max(mls->largest, distance);
            }
}

/* 0 when out of memory. */
static int dgfem_mvci_mls_create(const dgfem_mvc *body, dgfem_mvci_scratch *scratch, dgfem_mvci_mls *mls) {
    size_t nodes = (size_t)body->node_count, elements = (size_t)body->element_count;
    memset(mls, 0, sizeof *mls);
    mls->radius = (dgfem_real *)dgfem_mvci_take(scratch, nodes, sizeof(dgfem_real));
    mls->element_mark = (int *)dgfem_mvci_take(scratch, elements, sizeof(int));
    mls->away = (dgfem_real *)dgfem_mvci_take(scratch, elements, sizeof(dgfem_real));
    mls->path = (dgfem_real *)dgfem_mvci_take(scratch, elements, sizeof(dgfem_real));
    mls->queued = (char *)dgfem_mvci_take(scratch, elements, 1);
    mls->queue = (int *)dgfem_mvci_take(scratch, elements, sizeof(int));
    mls->touched = (int *)dgfem_mvci_take(scratch, elements, sizeof(int));
    mls->node_mark = (int *)dgfem_mvci_take(scratch, nodes, sizeof(int));
    mls->ways = (dgfem_real *)dgfem_mvci_take(scratch, nodes, sizeof(dgfem_real));
    mls->samples = (int *)dgfem_mvci_take(scratch, nodes, sizeof(int));
    mls->theta = (dgfem_real *)dgfem_mvci_take(scratch, nodes, sizeof(dgfem_real));
    if (!mls->radius || !mls->element_mark || !mls->away || !mls->path || !mls->queued || !mls->queue ||
        !mls->touched || !mls->node_mark || !mls->ways || !mls->samples || !mls->theta)
        return 0;
    dgfem_mvci_mls_measure(body, mls);
    return 1;
}

/* ---- which nodes reach a point ---- */

/* Distance from x, outside of it, to an element. */
static dgfem_real dgfem_mvci_element_distance(const dgfem_mvc *body, int e, dgfem_vec3 x) {
    int face_count;
    const int *faces = dgfem_mvci_element_faces(body->mesh, e, &face_count);
    dgfem_real least = -1;
    for (int k = 0; k < face_count; k++) {
        int count;
        const int *at = dgfem_mvci_face_triangles(body->mesh, faces[k] / 2, &count);
        for (int t = 0; t < count; t++, at += 3) {
            dgfem_vec3 p[3];
            for (int i = 0; i < 3; i++) p[i] = body->rest[at[i]];
            dgfem_real distance = dgfem_mvci_distance(dgfem_mvci_nearest_in_triangle(p, x), x);
            if (least < 0 || distance < least) least = distance;
        }
    }
    return least;
}

/* mls->path of all elements that nodes can reach the point through; returns their number, in mls->touched. A shorter
   way may be found late: then what lies behind is looked at again. */
static int dgfem_mvci_mls_spread(const dgfem_mvc *body, dgfem_mvci_mls *mls, int start, dgfem_vec3 x) {
    int first = 0, waiting = 1, touched = 1, ring = body->element_count;
    mls->vertex++;
    mls->element_mark[start] = mls->vertex, mls->path[start] = mls->away[start] = 0;
    mls->queue[0] = mls->touched[0] = start;
    for (; waiting; waiting--) {
        int e = mls->queue[first], face_count;
        const int *faces = dgfem_mvci_element_faces(body->mesh, e, &face_count);
        first = first + 1 < ring ? first + 1 : 0;
        mls->queued[e] = 0;
        for (int k = 0; k < face_count; k++) {
            int other = body->mesh->faces[faces[k] / 2].owner[!(faces[k] & 1)];
            if (other == DGFEM_NONE) continue;
            if (mls->element_mark[other] != mls->vertex) {
                mls->element_mark[other] = mls->vertex;
                mls->away[other] = dgfem_mvci_element_distance(body, other, x);
                mls->path[other] = mls->largest;
                mls->touched[touched++] = other;
            }
            dgfem_real path = dgfem_mvci_max(mls->path[e], mls->away[other]);
            if (!(path < mls->path[other])) continue;
            mls->path[other] = path;
            if (mls->queued[other]) continue;
            mls->queued[other] = 1;
            mls->queue[(first + waiting++ - 1) % ring] = other; /* `waiting` counts e still, which has left */
        }
    }
    return touched;
}

/* mls->samples: nodes whose windows are not zero at x; mls->theta, of which *sum is the sum. Returns their number. */
static int dgfem_mvci_mls_collect(const dgfem_mvc *body, dgfem_mvci_mls *mls, int start, dgfem_vec3 x,
                                  dgfem_real *sum) {
    const dgfem_mvc_system *system = body->system;
    int touched = dgfem_mvci_mls_spread(body, mls, start, x), found = 0, count = 0;
    for (int t = 0; t < touched; t++) {
        int e = mls->touched[t];
        for (int i = system->node_start[e]; i < system->node_start[e + 1]; i++) {
            int node = system->nodes[i];
            if (mls->node_mark[node] != mls->vertex) {
                mls->node_mark[node] = mls->vertex;
                mls->ways[node] = mls->path[e];
                mls->samples[found++] = node;
            }
            if (mls->path[e] < mls->ways[node]) mls->ways[node] = mls->path[e];
        }
    }
    *sum = 0;
    for (int k = 0; k < found; k++) {
        int node = mls->samples[k];
        dgfem_real q = dgfem_mvci_max(dgfem_mvci_distance(x, body->rest[node]), mls->ways[node]) / mls->radius[node];
        dgfem_real rest = 1 - q * q;
        if (!(rest > 0)) continue;
        mls->samples[count] = node;
        mls->theta[count] = (dgfem_real)exp(-2 * (double)(q * q)) * rest * rest * rest;
        *sum += mls->theta[count++];
    }
    return count;
}

/* ---- weights ---- */

/* Weights phi of mls->samples at x, which belongs to the element `start`, with `inside` the nearest point of it.
   Returns their number; 0 where the samples do not determine an affine function, all nearly in a plane. */
static int dgfem_mvci_mls_weights(const dgfem_mvc *body, dgfem_mvci_mls *mls, int start, dgfem_vec3 x,
                                  dgfem_vec3 inside, dgfem_real *phi) {
    const dgfem_real least = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-4) : DGFEM_R(1e-9);
    dgfem_vec3 box[2], beyond = dgfem_mvci_sub(x, inside), mean = dgfem_mvci_vec3(0, 0, 0);
    dgfem_real sum, far = dgfem_mvci_norm(beyond);
    dgfem_mat3 c, inverse;
    dgfem_mvci_element_box(body, start, box);
    dgfem_real limit = DGFEM_MVCI_OUTSIDE / 2 * dgfem_mvci_distance(box[0], box[1]);
    dgfem_vec3 window = far > limit ? dgfem_mvci_axpy(inside, limit / far, beyond) : x;
    int count = dgfem_mvci_mls_collect(body, mls, start, window, &sum);
    if (count < 4) return 0;
    for (int k = 0; k < count; k++)
        mean = dgfem_mvci_axpy(mean, mls->theta[k] / sum, dgfem_mvci_sub(body->rest[mls->samples[k]], window));
    memset(&c, 0, sizeof c);
    for (int k = 0; k < count; k++) {
        dgfem_vec3 d = dgfem_mvci_sub(dgfem_mvci_sub(body->rest[mls->samples[k]], window), mean);
        dgfem_mvci_add_outer(&c, mls->theta[k] / sum, d, d);
        phi[k] = mls->theta[k] / sum;
    }
    dgfem_real third = (c.m[0][0] + c.m[1][1] + c.m[2][2]) / 3;
    if (!dgfem_mvci_invert(&c, &inverse)) return 0;
    dgfem_vec3 rows[2];
    for (int i = 0; i < 2; i++) rows[i] = dgfem_mvci_vec3(c.m[i][0], c.m[i][1], c.m[i][2]);
    dgfem_vec3 last = dgfem_mvci_vec3(c.m[2][0], c.m[2][1], c.m[2][2]);
    if (!(dgfem_mvci_dot(last, dgfem_mvci_cross(rows[0], rows[1])) > least * third * third * third)) return 0;
    for (int pass = 0; pass < 2; pass++) { /* the second takes what round-off has left */
        dgfem_vec3 missing = dgfem_mvci_sub(x, window);
        for (int k = 0; k < count; k++)
            missing = dgfem_mvci_axpy(missing, -phi[k], dgfem_mvci_sub(body->rest[mls->samples[k]], window));
        dgfem_vec3 slope = dgfem_mvci_multiply(&inverse, missing);
        for (int k = 0; k < count; k++) {
            dgfem_vec3 d = dgfem_mvci_sub(dgfem_mvci_sub(body->rest[mls->samples[k]], window), mean);
            phi[k] += mls->theta[k] / sum * dgfem_mvci_dot(d, slope);
        }
    }
    return count;
}
