#pragma once
#include "mesh.c"
/* Which element of a mesh contains a point, or is nearest to it: winding numbers of elements, distances of faces, and
   buckets of element boxes that keep the search short. */

#define DGFEM_ON_FACE                                                                                                  \
    (DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-5) : DGFEM_R(1e-9)) /* of the radius: a point that near is on the face */

typedef struct dgfemi_locator {
    const dgfem_mesh *mesh;
    dgfem_vec3 *lower, *upper;          /* [element_count] boxes of the elements */
    dgfem_vec3 origin;                  /* lower corner of all buckets */
    dgfem_real cell;                    /* edge of a bucket */
    int size[3];                        /* buckets along x, y, z */
    int *bucket_start, *bucket_element; /* elements whose box meets the bucket, ascending */
    int *seen, stamp;                   /* [element_count] search that met the element last */
} dgfemi_locator;

typedef struct dgfemi_location {
    int element;         /* that contains the point, or the nearest one */
    dgfem_real distance; /* from the element; 0 inside */
    dgfem_vec3 nearest;  /* point of the element; the point itself inside */
} dgfemi_location;

static int dgfemi_locator_coordinate(const dgfemi_locator *locator, dgfem_vec3 x, int axis) {
    dgfem_real t = (dgfemi_axis(x, axis) - dgfemi_axis(locator->origin, axis)) / locator->cell;
    if (!(t > 0)) return 0;
    if (t >= (dgfem_real)locator->size[axis]) return locator->size[axis] - 1;
    return (int)t;
}

static int dgfemi_locator_bucket(const dgfemi_locator *locator, int i, int j, int k) {
    return i + locator->size[0] * (j + locator->size[1] * k);
}

/* The smallest buckets of which there are about two per element at most. */
static void dgfemi_locator_resolution(dgfemi_locator *locator, dgfem_vec3 extent) {
    double limit = 2.0 * (double)locator->mesh->element_count + 64.0;
    dgfem_real largest = dgfemi_max(extent.x, dgfemi_max(extent.y, extent.z));
    double room;
    locator->cell = largest / (dgfem_real)locator->mesh->element_count;
    do {
        locator->cell *= DGFEM_R(1.26);
        room = (floor((double)extent.x / (double)locator->cell) + 1) *
               (floor((double)extent.y / (double)locator->cell) + 1) *
               (floor((double)extent.z / (double)locator->cell) + 1);
    } while (room > limit);
    for (int axis = 0; axis < 3; axis++) locator->size[axis] = (int)(dgfemi_axis(extent, axis) / locator->cell) + 1;
}

static int dgfemi_locator_bucket_count(const dgfemi_locator *locator) {
    return locator->size[0] * locator->size[1] * locator->size[2];
}

/* The buckets that a box meets: first <= i, j, k <= last. What is outside of them all belongs to the outermost ones. */
typedef struct dgfemi_locator_range {
    int first[3], last[3];
} dgfemi_locator_range;

static dgfemi_locator_range dgfemi_locator_range_of(const dgfemi_locator *locator, dgfem_vec3 lower, dgfem_vec3 upper) {
    dgfemi_locator_range range;
    for (int axis = 0; axis < 3; axis++) {
        range.first[axis] = dgfemi_locator_coordinate(locator, lower, axis);
        range.last[axis] = dgfemi_locator_coordinate(locator, upper, axis);
    }
    return range;
}

/* For each bucket that the box of an element meets: counts the element (elements NULL) or enters it. */
static void dgfemi_locator_enter(const dgfemi_locator *locator, int element, int *counts, int *elements) {
    dgfemi_locator_range range = dgfemi_locator_range_of(locator, locator->lower[element], locator->upper[element]);
    for (int k = range.first[2]; k <= range.last[2]; k++)
        for (int j = range.first[1]; j <= range.last[1]; j++)
            for (int i = range.first[0]; i <= range.last[0]; i++) {
                int bucket = dgfemi_locator_bucket(locator, i, j, k);
                if (elements) elements[counts[bucket]] = element;
                counts[bucket]++;
            }
}

/* 1 on success, 0 when out of memory. All memory is the arena's. */
static int dgfemi_locator_make(dgfemi_arena *arena, const dgfem_mesh *mesh, dgfemi_locator *locator) {
    size_t elements = (size_t)mesh->element_count;
    dgfem_vec3 upper;
    int buckets, total = 0;
    int *fill;
    memset(locator, 0, sizeof *locator);
    locator->mesh = mesh;
    locator->lower = (dgfem_vec3 *)dgfemi_arena_allocate(arena, elements, sizeof(dgfem_vec3));
    locator->upper = (dgfem_vec3 *)dgfemi_arena_allocate(arena, elements, sizeof(dgfem_vec3));
    locator->seen = (int *)dgfemi_arena_allocate_zero(arena, elements, sizeof(int));
    if (!locator->lower || !locator->upper || !locator->seen) return 0;
    for (int e = 0; e < mesh->element_count; e++)
        dgfemi_mesh_element_box(mesh, e, &locator->lower[e], &locator->upper[e]);
    locator->origin = locator->lower[0], upper = locator->upper[0];
    for (int e = 1; e < mesh->element_count; e++) {
        locator->origin = dgfemi_min3(locator->origin, locator->lower[e]);
        upper = dgfemi_max3(upper, locator->upper[e]);
    }
    dgfemi_locator_resolution(locator, dgfemi_sub(upper, locator->origin));
    buckets = dgfemi_locator_bucket_count(locator);
    locator->bucket_start = (int *)dgfemi_arena_allocate_zero(arena, (size_t)buckets + 1, sizeof(int));
    fill = (int *)dgfemi_arena_allocate_zero(arena, (size_t)buckets, sizeof(int));
    if (!locator->bucket_start || !fill) return 0;
    for (int e = 0; e < mesh->element_count; e++) dgfemi_locator_enter(locator, e, fill, NULL);
    for (int b = 0; b < buckets; b++) {
        int count = fill[b];
        locator->bucket_start[b] = fill[b] = total;
        total += count;
    }
    locator->bucket_start[buckets] = total;
    locator->bucket_element = (int *)dgfemi_arena_allocate(arena, (size_t)total, sizeof(int));
    if (!locator->bucket_element) return 0;
    for (int e = 0; e < mesh->element_count; e++) dgfemi_locator_enter(locator, e, fill, locator->bucket_element);
    return 1;
}

/* ---- faces and elements ---- */

/* Whether a point of the face's plane lies in the face: parity of the crossings of a ray, seen along the axis on which
   the face is largest. */
static int dgfemi_face_covers(const dgfem_mesh *mesh, const dgfem_face *face, dgfem_vec3 x) {
    dgfem_real nx = dgfemi_abs(face->normal.x), ny = dgfemi_abs(face->normal.y), nz = dgfemi_abs(face->normal.z);
    int drop = nx >= ny && nx >= nz ? 0 : ny >= nz ? 1 : 2;
    int u = (drop + 1) % 3, v = (drop + 2) % 3, inside = 0;
    dgfem_real xu = dgfemi_axis(x, u), xv = dgfemi_axis(x, v);
    for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        int count = mesh->loops[l].count;
        for (int i = 0; i < count; i++) {
            dgfem_vec3 a = mesh->vertices[loop[i]], b = mesh->vertices[loop[i + 1 < count ? i + 1 : 0]];
            dgfem_real av = dgfemi_axis(a, v), bv = dgfemi_axis(b, v);
            if ((av > xv) == (bv > xv)) continue;
            if (xu < dgfemi_axis(a, u) + (xv - av) / (bv - av) * (dgfemi_axis(b, u) - dgfemi_axis(a, u)))
                inside = !inside;
        }
    }
    return inside;
}

static dgfem_vec3 dgfemi_nearest_on_segment(dgfem_vec3 a, dgfem_vec3 b, dgfem_vec3 x) {
    dgfem_vec3 d = dgfemi_sub(b, a);
    dgfem_real square = dgfemi_dot(d, d), t = dgfemi_dot(dgfemi_sub(x, a), d);
    if (!(t > 0)) return a;
    if (t >= square) return b;
    return dgfemi_add_scaled(a, t / square, d);
}

static dgfem_vec3 dgfemi_face_nearest(const dgfem_mesh *mesh, const dgfem_face *face, dgfem_vec3 x) {
    dgfem_real height = dgfemi_dot(face->normal, dgfemi_sub(x, face->centre)), best_distance = -1;
    dgfem_vec3 foot = dgfemi_add_scaled(x, -height, face->normal), best = foot;
    if (dgfemi_face_covers(mesh, face, foot)) return foot;
    for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        int count = mesh->loops[l].count;
        for (int i = 0; i < count; i++) {
            dgfem_vec3 p =
                dgfemi_nearest_on_segment(mesh->vertices[loop[i]], mesh->vertices[loop[i + 1 < count ? i + 1 : 0]], x);
            dgfem_real distance = dgfemi_distance(p, x);
            if (best_distance < 0 || distance < best_distance) best_distance = distance, best = p;
        }
    }
    return best;
}

/* Solid angle of the face as a fraction of the sphere, positive seen from behind its normal: the fans of its loops,
   each triangle by tan(angle / 2) = a.(b x c) / (|a||b||c| + (a.b)|c| + (b.c)|a| + (c.a)|b|). */
static double dgfemi_face_winding(const dgfem_mesh *mesh, const dgfem_face *face, dgfem_vec3 x) {
    double angle = 0;
    for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        dgfem_vec3 a = dgfemi_sub(mesh->vertices[loop[0]], x), b = dgfemi_sub(mesh->vertices[loop[1]], x);
        dgfem_real na = dgfemi_norm(a), nb = dgfemi_norm(b);
        for (int i = 2; i < mesh->loops[l].count; i++) {
            dgfem_vec3 c = dgfemi_sub(mesh->vertices[loop[i]], x);
            dgfem_real nc = dgfemi_norm(c);
            dgfem_real denominator =
                na * nb * nc + dgfemi_dot(a, b) * nc + dgfemi_dot(b, c) * na + dgfemi_dot(c, a) * nb;
            angle += 2 * atan2((double)dgfemi_dot(a, dgfemi_cross(b, c)), (double)denominator);
            b = c, nb = nc;
        }
    }
    return angle / 12.566370614359172;
}

/* 1 inside. In the plane of a face the solid angle is either zero or undefined: such faces are left out. */
static int dgfemi_element_winds_around(const dgfem_mesh *mesh, int element, dgfem_vec3 x) {
    const dgfem_element *e = &mesh->elements[element];
    double winding = 0;
    for (int k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        dgfem_real height = dgfemi_dot(face->normal, dgfemi_sub(x, face->centre));
        if (!(dgfemi_abs(height) > DGFEM_ON_FACE * e->radius)) continue;
        winding += dgfemi_mesh_sign(mesh, element, mesh->element_faces[k]) * dgfemi_face_winding(mesh, face, x);
    }
    return winding > 0.5;
}

#define DGFEM_STEEP DGFEM_R(1e-3) /* a ray that meets a face at a smaller sine says nothing */

/* Whether the ray from x along the x axis passes through a face, seen along the ray: 1, 0, or -1 where it passes an
   edge too closely to tell. */
static int dgfemi_face_meets_ray(const dgfem_mesh *mesh, const dgfem_face *face, dgfem_vec3 x, dgfem_real near) {
    int inside = 0;
    for (int l = face->loop_start; l < face->loop_start + face->loop_count; l++) {
        const int *loop = mesh->loop_vertices + mesh->loops[l].start;
        int count = mesh->loops[l].count;
        dgfem_vec3 a = mesh->vertices[loop[count - 1]];
        dgfem_real ay = a.y - x.y, az = a.z - x.z;
        for (int i = 0; i < count; i++) {
            dgfem_vec3 b = mesh->vertices[loop[i]];
            dgfem_real by = b.y - x.y, bz = b.z - x.z;
            if ((az > 0) != (bz > 0)) {
                dgfem_real side = ay * (bz - az) - az * (by - ay);
                if (dgfemi_abs(side) <= near * (dgfemi_abs(by - ay) + dgfemi_abs(bz - az))) return -1;
                if ((side > 0) == (bz > az)) inside = !inside;
            }
            ay = by, az = bz;
        }
    }
    return inside;
}

/* Whether x lies farther than `margin` behind the planes of all faces: inside, then, of any element. */
static int dgfemi_is_behind_faces(const dgfem_mesh *mesh, int element, dgfem_vec3 x, dgfem_real margin) {
    const dgfem_element *e = &mesh->elements[element];
    for (int k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        dgfem_real height = dgfemi_dot(face->normal, dgfemi_sub(x, face->centre));
        if (!(dgfemi_abs(height) > margin) || (height < 0) != (face->element[0] == element)) return 0;
    }
    return 1;
}

/* 1 inside and on a face. Behind the planes of all faces, or by the parity of the faces that a ray passes through;
   where it passes an edge closely or touches a face, the solid angles decide. */
static int dgfemi_element_contains(const dgfem_mesh *mesh, int element, dgfem_vec3 x) {
    const dgfem_element *e = &mesh->elements[element];
    dgfem_real near = DGFEM_ON_FACE * e->radius;
    int inside = 0;
    if (dgfemi_is_behind_faces(mesh, element, x, near)) return 1;
    for (int k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        dgfem_real height = dgfemi_dot(face->normal, dgfemi_sub(x, face->centre));
        if (dgfemi_abs(height) > near) continue;
        if (dgfemi_face_covers(mesh, face, dgfemi_add_scaled(x, -height, face->normal))) return 1;
    }
    for (int k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        int meets = dgfemi_face_meets_ray(mesh, face, x, near);
        dgfem_real height;
        if (meets == 0) continue;
        height = dgfemi_dot(face->normal, dgfemi_sub(x, face->centre));
        if (meets < 0 || dgfemi_abs(face->normal.x) < DGFEM_STEEP || dgfemi_abs(height) <= near)
            return dgfemi_element_winds_around(mesh, element, x);
        if ((height > 0) != (face->normal.x > 0)) inside = !inside;
    }
    return inside;
}

/* ---- search ---- */

/* Whether the face's plane alone is farther away than `distance`, beyond round-off. */
static int dgfemi_face_is_farther(const dgfem_face *face, dgfem_vec3 x, dgfem_real distance) {
    return dgfemi_abs(dgfemi_dot(face->normal, dgfemi_sub(x, face->centre))) > DGFEM_R(1.001) * distance;
}

/* Squared distance from a box. */
static dgfem_real dgfemi_box_square(dgfem_vec3 lower, dgfem_vec3 upper, dgfem_vec3 x) {
    dgfem_real dx = dgfemi_max(dgfemi_max(lower.x - x.x, x.x - upper.x), 0);
    dgfem_real dy = dgfemi_max(dgfemi_max(lower.y - x.y, x.y - upper.y), 0);
    dgfem_real dz = dgfemi_max(dgfemi_max(lower.z - x.z, x.z - upper.z), 0);
    return dx * dx + dy * dy + dz * dz;
}

/* Squared distance between two boxes. */
static dgfem_real dgfemi_boxes_square(dgfem_vec3 lower, dgfem_vec3 upper, dgfem_vec3 other_lower,
                                      dgfem_vec3 other_upper) {
    return dgfemi_box_square(lower, upper, dgfemi_min3(dgfemi_max3(lower, other_lower), other_upper));
}

static dgfem_real dgfemi_box_distance(dgfem_vec3 lower, dgfem_vec3 upper, dgfem_vec3 x) {
    dgfem_vec3 inside = dgfemi_min3(dgfemi_max3(x, lower), upper);
    return dgfemi_distance(inside, x);
}

/* Replaces the location by the element when that is nearer, or as near with a lower index. */
static void dgfemi_locator_try(const dgfemi_locator *locator, int element, dgfem_vec3 x, dgfemi_location *location) {
    const dgfem_mesh *mesh = locator->mesh;
    const dgfem_element *e = &mesh->elements[element];
    if (location->element != DGFEM_NONE &&
        dgfemi_box_distance(locator->lower[element], locator->upper[element], x) > location->distance)
        return;
    for (int k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        dgfem_vec3 p;
        dgfem_real distance;
        if (location->element != DGFEM_NONE && dgfemi_face_is_farther(face, x, location->distance)) continue;
        p = dgfemi_face_nearest(mesh, face, x), distance = dgfemi_distance(p, x);
        if (location->element == DGFEM_NONE || distance < location->distance ||
            (!(distance > location->distance) && element < location->element)) {
            location->element = element;
            location->distance = distance;
            location->nearest = p;
        }
    }
}

/* Tries the elements of all buckets whose largest difference of coordinates from `centre` is `ring`. */
static void dgfemi_locator_try_ring(dgfemi_locator *locator, const int centre[3], int ring, dgfem_vec3 x,
                                    dgfemi_location *location) {
    int first[3], last[3];
    for (int axis = 0; axis < 3; axis++) {
        first[axis] = centre[axis] > ring ? centre[axis] - ring : 0;
        last[axis] = centre[axis] + ring < locator->size[axis] ? centre[axis] + ring : locator->size[axis] - 1;
    }
    for (int k = first[2]; k <= last[2]; k++)
        for (int j = first[1]; j <= last[1]; j++) {
            int shell = abs(k - centre[2]) == ring || abs(j - centre[1]) == ring;
            for (int i = first[0]; i <= last[0]; i++) {
                int bucket = dgfemi_locator_bucket(locator, i, j, k);
                if (!shell && abs(i - centre[0]) != ring) continue;
                for (int n = locator->bucket_start[bucket]; n < locator->bucket_start[bucket + 1]; n++) {
                    int element = locator->bucket_element[n];
                    if (locator->seen[element] == locator->stamp) continue;
                    locator->seen[element] = locator->stamp;
                    dgfemi_locator_try(locator, element, x, location);
                }
            }
        }
}

/* The element with the lowest index that contains x, else the nearest one. */
static dgfemi_location dgfemi_locate(dgfemi_locator *locator, dgfem_vec3 x) {
    dgfemi_location location;
    dgfem_real margin = locator->cell;
    int centre[3], rings = 0, bucket;
    for (int axis = 0; axis < 3; axis++) {
        dgfem_real t = dgfemi_axis(x, axis) - dgfemi_axis(locator->origin, axis);
        centre[axis] = dgfemi_locator_coordinate(locator, x, axis);
        t -= (dgfem_real)centre[axis] * locator->cell;
        margin = dgfemi_max(0, dgfemi_min(margin, dgfemi_min(t, locator->cell - t)));
        if (locator->size[axis] > rings) rings = locator->size[axis];
    }
    bucket = dgfemi_locator_bucket(locator, centre[0], centre[1], centre[2]);
    location.distance = 0, location.nearest = x;
    for (int n = locator->bucket_start[bucket]; n < locator->bucket_start[bucket + 1]; n++) {
        int element = locator->bucket_element[n];
        location.element = element;
        if (!(dgfemi_box_distance(locator->lower[element], locator->upper[element], x) > 0) &&
            dgfemi_element_contains(locator->mesh, element, x))
            return location;
    }
    location.element = DGFEM_NONE;
    locator->stamp++;
    for (int ring = 0; ring <= rings; ring++) { /* further rings are at least margin + ring * cell away */
        dgfemi_locator_try_ring(locator, centre, ring, x, &location);
        if (location.element != DGFEM_NONE && location.distance < margin + (dgfem_real)ring * locator->cell) break;
    }
    DGFEM_ASSERT(location.element != DGFEM_NONE);
    return location;
}

/* Where x lies with respect to one element. */
static dgfemi_location dgfemi_locate_in(const dgfem_mesh *mesh, int element, dgfem_vec3 x) {
    const dgfem_element *e = &mesh->elements[element];
    dgfemi_location location;
    location.element = element, location.distance = 0, location.nearest = x;
    if (dgfemi_element_contains(mesh, element, x)) return location;
    location.distance = -1;
    for (int k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        dgfem_vec3 p;
        dgfem_real distance;
        if (location.distance >= 0 && dgfemi_face_is_farther(face, x, location.distance)) continue;
        p = dgfemi_face_nearest(mesh, face, x), distance = dgfemi_distance(p, x);
        if (location.distance < 0 || distance < location.distance) location.distance = distance, location.nearest = p;
    }
    return location;
}

/* ---- the inside of an element ---- */

/* Whether an element contains a point and has all of its faces farther away than `margin`. */
static int dgfemi_element_encloses(const dgfem_mesh *mesh, int element, dgfem_vec3 x, dgfem_real margin) {
    const dgfem_element *e = &mesh->elements[element];
    if (dgfemi_is_behind_faces(mesh, element, x, margin)) return 1;
    for (int k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        if (!dgfemi_face_is_farther(face, x, margin) &&
            !(dgfemi_distance(dgfemi_face_nearest(mesh, face, x), x) > margin))
            return 0;
    }
    return dgfemi_element_contains(mesh, element, x);
}

#define DGFEM_DEPTH DGFEM_R(0.02) /* of the way from a point on the boundary to the centre, or of the radius */
#define DGFEM_DEPTH_ROUNDS 6

/* A point inside an element near one of its points: beyond round-off, so that no other element contains it. On the way
   to the centre; where that leads out of the element, which need not be convex, straight in from the faces around. */
static dgfem_vec3 dgfemi_locate_inside(const dgfem_mesh *mesh, int element, dgfem_vec3 x) {
    const dgfem_element *e = &mesh->elements[element];
    dgfem_real near = DGFEM_ON_FACE * e->radius, depth = DGFEM_DEPTH * e->radius;
    dgfem_vec3 inwards = dgfemi_vec3(0, 0, 0), first = dgfemi_add_scaled(x, DGFEM_DEPTH, dgfemi_sub(e->centre, x));
    if (dgfemi_element_encloses(mesh, element, first, 2 * near)) return first;
    for (int k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        if (dgfemi_face_is_farther(face, x, near) || dgfemi_distance(dgfemi_face_nearest(mesh, face, x), x) > near)
            continue;
        inwards = dgfemi_add_scaled(inwards, (dgfem_real)-dgfemi_mesh_sign(mesh, element, mesh->element_faces[k]),
                                    face->normal);
    }
    inwards = dgfemi_normalized(inwards);
    for (int round = 0; round < DGFEM_DEPTH_ROUNDS; round++, depth *= DGFEM_R(0.5)) {
        dgfem_vec3 inside = dgfemi_add_scaled(x, depth, inwards);
        if (dgfemi_element_encloses(mesh, element, inside, 2 * near)) return inside;
    }
    return first;
}
