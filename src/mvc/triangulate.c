#pragma once
#include "mesh.c"
/* Triangles of faces, stored once for both sides.

   Ears are cut in the order of their smallest angles, the largest first, nodes of lower index first where they are
   equal: so the result depends on the face alone. Hanging nodes make collinear corners. An ear is refused where it is
   flat, where its diagonal meets another node (the trace would not conform there), and where it leaves only a line. */

/* Triangles lower than this part of their longest side are flat; so is what is within round-off. */
#if DGFEM_REAL_IS_FLOAT
#define DGFEM_MVC_FLAT 1e-5
#else
#define DGFEM_MVC_FLAT 1e-9
#endif

/* Deviation from a plane, relative to the size of coordinates, that is taken for round-off. */
#if DGFEM_REAL_IS_FLOAT
#define DGFEM_MVC_PLANAR 1e-5
#else
#define DGFEM_MVC_PLANAR 1e-11
#endif

typedef struct dgfem_mvci_polygon {
    double (*point)[2];
    int *node;
    int *left; /* indices of the corners not yet cut off, in order */
    int *triangles;
    int count, capacity;
    double flat; /* round-off of a height */
} dgfem_mvci_polygon;

static void dgfem_mvci_polygon_free(const dgfem_hooks *hooks, dgfem_mvci_polygon *polygon) {
    dgfem_mvci_free(hooks, polygon->point);
    dgfem_mvci_free(hooks, polygon->node);
    dgfem_mvci_free(hooks, polygon->left);
    dgfem_mvci_free(hooks, polygon->triangles);
}

static int dgfem_mvci_polygon_room(const dgfem_hooks *hooks, dgfem_mvci_polygon *polygon, int count) {
    if (count <= polygon->capacity) return 1;
    dgfem_mvci_polygon_free(hooks, polygon);
    polygon->capacity = 0;
    polygon->point = (double(*)[2])dgfem_mvci_allocate(hooks, 2 * (size_t)count, sizeof *polygon->point);
    polygon->node = (int *)dgfem_mvci_allocate(hooks, 2 * (size_t)count, sizeof(int));
    polygon->left = (int *)dgfem_mvci_allocate(hooks, 2 * (size_t)count, sizeof(int));
    polygon->triangles = (int *)dgfem_mvci_allocate(hooks, 6 * (size_t)count, sizeof(int));
    if (!polygon->point || !polygon->node || !polygon->left || !polygon->triangles) return 0;
    polygon->capacity = 2 * count;
    return 1;
}

/* Projects a loop along a unit normal. Returns how far its nodes are from a plane, relative to their coordinates. */
static double dgfem_mvci_polygon_project(const dgfem_mvci_mesh *mesh, const int *loop, int count, dgfem_vec3 normal,
                                         dgfem_mvci_polygon *polygon) {
    dgfem_vec3 start = mesh->rest[loop[0]], u, v;
    dgfem_real ax = dgfem_mvci_abs(normal.x), ay = dgfem_mvci_abs(normal.y), az = dgfem_mvci_abs(normal.z);
    double off = 0, reach = 0;
    u = dgfem_mvci_vec3(ax <= ay && ax <= az, ay < ax && ay <= az, az < ax && az < ay);
    u = dgfem_mvci_unit(dgfem_mvci_cross(u, normal));
    v = dgfem_mvci_cross(normal, u);
    for (int i = 0; i < count; i++) {
        dgfem_vec3 x = mesh->rest[loop[i]], d = dgfem_mvci_sub(x, start);
        double size = (double)dgfem_mvci_max(dgfem_mvci_norm(x), dgfem_mvci_norm(d));
        polygon->node[i] = loop[i];
        polygon->point[i][0] = (double)dgfem_mvci_dot(d, u);
        polygon->point[i][1] = (double)dgfem_mvci_dot(d, v);
        if (size > reach) reach = size;
    }
    for (int i = 0; i < count; i++) {
        double height = fabs((double)dgfem_mvci_dot(dgfem_mvci_sub(mesh->rest[loop[i]], start), normal));
        if (height > off) off = height;
    }
    polygon->count = count;
    polygon->flat = 16 * (double)DGFEM_MVC_EPSILON * reach;
    return reach > 0 ? off / reach : 0;
}

static double dgfem_mvci_turn(const double *a, const double *b, const double *c) {
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

static double dgfem_mvci_square(const double *a, const double *b) {
    return (a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]);
}

/* Tangent of the smallest angle; not positive where the triangle is flat or turned over. */
static double dgfem_mvci_ear_angle(const double *a, const double *b, const double *c, double flat) {
    double l[3], area = dgfem_mvci_turn(a, b, c), sum, least, most;
    l[0] = dgfem_mvci_square(a, b), l[1] = dgfem_mvci_square(b, c), l[2] = dgfem_mvci_square(c, a);
    sum = l[0] + l[1] + l[2];
    least = l[0] < l[1] ? l[0] : l[1], most = l[0] > l[1] ? l[0] : l[1];
    if (l[2] < least) least = l[2];
    if (l[2] > most) most = l[2];
    if (!(area > DGFEM_MVC_FLAT * most + flat * sqrt(most))) return 0;
    return area / ((sum - 2 * least) / 2);
}

/* Whether no other corner lies in or on the ear at position k of those left. */
static int dgfem_mvci_ear_is_clear(const dgfem_mvci_polygon *polygon, int left, int k) {
    int previous = polygon->left[(k + left - 1) % left], next = polygon->left[(k + 1) % left];
    const double *a = polygon->point[previous], *b = polygon->point[polygon->left[k]], *c = polygon->point[next];
    double ab = sqrt(dgfem_mvci_square(a, b)), bc = sqrt(dgfem_mvci_square(b, c)), ca = sqrt(dgfem_mvci_square(c, a));
    for (int i = 2; i < left - 1; i++) {
        const double *p = polygon->point[polygon->left[(k + i) % left]];
        if (dgfem_mvci_turn(a, b, p) > -ab * (polygon->flat + DGFEM_MVC_FLAT * ab) &&
            dgfem_mvci_turn(b, c, p) > -bc * (polygon->flat + DGFEM_MVC_FLAT * bc) &&
            dgfem_mvci_turn(c, a, p) > -ca * (polygon->flat + DGFEM_MVC_FLAT * ca))
            return 0;
    }
    return 1;
}

/* Whether the corners left without the one at position k enclose an area. */
static int dgfem_mvci_ear_leaves_area(const dgfem_mvci_polygon *polygon, int left, int k) {
    const double *start = polygon->point[polygon->left[(k + 1) % left]];
    double area = 0, most = 0;
    for (int i = 2; i < left; i++) {
        const double *a = polygon->point[polygon->left[(k + i) % left]];
        double square = dgfem_mvci_square(start, a);
        if (square > most) most = square;
        if (i + 1 < left) area += dgfem_mvci_turn(start, a, polygon->point[polygon->left[(k + i + 1) % left]]);
    }
    return area > DGFEM_MVC_FLAT * most + polygon->flat * sqrt(most);
}

/* Position of the best ear of those left, or DGFEM_NONE. */
static int dgfem_mvci_best_ear(const dgfem_mvci_polygon *polygon, int left) {
    int best = DGFEM_NONE;
    double best_angle = 0;
    for (int k = 0; k < left; k++) {
        int i = polygon->left[k], previous = polygon->left[(k + left - 1) % left];
        double angle = dgfem_mvci_ear_angle(polygon->point[previous], polygon->point[i],
                                            polygon->point[polygon->left[(k + 1) % left]], polygon->flat);
        if (!(angle > 0) || angle < best_angle * (1 - 1e-6)) continue;
        if (angle <= best_angle * (1 + 1e-6) && polygon->node[i] > polygon->node[polygon->left[best]]) continue;
        if (!dgfem_mvci_ear_is_clear(polygon, left, k) || !dgfem_mvci_ear_leaves_area(polygon, left, k)) continue;
        best = k;
        best_angle = angle;
    }
    return best;
}

/* Fills polygon->triangles with nodes; returns their number, 0 where there is no good triangulation. */
static int dgfem_mvci_polygon_triangulate(dgfem_mvci_polygon *polygon) {
    int left = polygon->count, count = 0;
    for (int i = 0; i < left; i++) polygon->left[i] = i;
    while (left >= 3) {
        int k = left > 3 ? dgfem_mvci_best_ear(polygon, left) : 1, corner[3];
        if (k == DGFEM_NONE) return 0;
        corner[0] = polygon->left[(k + left - 1) % left];
        corner[1] = polygon->left[k];
        corner[2] = polygon->left[(k + 1) % left];
        if (!(dgfem_mvci_ear_angle(polygon->point[corner[0]], polygon->point[corner[1]], polygon->point[corner[2]],
                                   polygon->flat) > 0))
            return 0;
        for (int i = 0; i < 3; i++) polygon->triangles[3 * count + i] = polygon->node[corner[i]];
        count++;
        for (int i = k; i + 1 < left; i++) polygon->left[i] = polygon->left[i + 1];
        left--;
    }
    return count;
}

/* Makes the triangles of a face faces of their own; the first takes the place of the face. 0 when out of memory. */
static int dgfem_mvci_divide_face(dgfem_mvci_mesh *mesh, int face, const int *triangles, int count) {
    for (int t = 0; t < count; t++) {
        int index = face, start = dgfem_mvci_append(&mesh->hooks, &mesh->triangles, triangles + 3 * t, 3);
        if (start == DGFEM_NONE) return 0;
        if (t) {
            dgfem_mvci_face old = mesh->faces[face];
            index = dgfem_mvci_add_face(mesh, old.owner[0], old.owner[1], triangles + 3 * t, 3, old.from, old.wall);
            if (index == DGFEM_NONE) return 0;
            for (int side = 0; side < 2; side++)
                if (old.owner[side] != DGFEM_NONE && !dgfem_mvci_add_element_face(mesh, old.owner[side], index, side))
                    return 0;
        } else if (!dgfem_mvci_set_loop(mesh, face, triangles, 3)) {
            return 0;
        }
        mesh->faces[index].triangle = start;
        mesh->faces[index].triangle_count = 1;
    }
    return 1;
}

/* Triangulates one face; divides it where it is bent. DGFEM_ERROR_DEGENERATE where it has no area, or no
   good triangles. */
static dgfem_status dgfem_mvci_settle_face(dgfem_mvci_mesh *mesh, int face, dgfem_mvci_polygon *polygon) {
    int count = mesh->faces[face].count;
    if (!dgfem_mvci_polygon_room(&mesh->hooks, polygon, count)) return DGFEM_ERROR_MEMORY;
    const int *loop = mesh->loops.data + mesh->faces[face].loop;
    dgfem_vec3 normal = dgfem_mvci_unit(dgfem_mvci_loop_area(mesh->rest, loop, count));
    double off = dgfem_mvci_polygon_project(mesh, loop, count, normal, polygon);
    int triangles = count < 3 ? 0 : dgfem_mvci_polygon_triangulate(polygon);
    if (!triangles) return DGFEM_ERROR_DEGENERATE;
    if (triangles > 1 && off > DGFEM_MVC_PLANAR)
        return dgfem_mvci_divide_face(mesh, face, polygon->triangles, triangles) ? DGFEM_OK : DGFEM_ERROR_MEMORY;
    int start = dgfem_mvci_append(&mesh->hooks, &mesh->triangles, polygon->triangles, 3 * triangles);
    if (start == DGFEM_NONE) return DGFEM_ERROR_MEMORY;
    mesh->faces[face].triangle = start;
    mesh->faces[face].triangle_count = triangles;
    return DGFEM_OK;
}

/* Triangulates all faces that have no triangles. DGFEM_ERROR_DEGENERATE: those named in `bad` (may be NULL) have none,
   the others do. */
static dgfem_status dgfem_mvci_mesh_settle(dgfem_mvci_mesh *mesh, dgfem_mvci_ints *bad) {
    dgfem_mvci_polygon polygon;
    dgfem_status status = DGFEM_OK;
    int faces = mesh->face_count, degenerate = 0;
    memset(&polygon, 0, sizeof polygon);
    for (int f = 0; f < faces && status != DGFEM_ERROR_MEMORY; f++) {
        if (mesh->faces[f].owner[0] == DGFEM_NONE || mesh->faces[f].triangle_count) continue;
        status = dgfem_mvci_settle_face(mesh, f, &polygon);
        if (status != DGFEM_ERROR_DEGENERATE) continue;
        degenerate = 1;
        if (bad && !dgfem_mvci_push(&mesh->hooks, bad, f)) status = DGFEM_ERROR_MEMORY;
    }
    dgfem_mvci_polygon_free(&mesh->hooks, &polygon);
    return status == DGFEM_ERROR_MEMORY ? status : degenerate ? DGFEM_ERROR_DEGENERATE : DGFEM_OK;
}
