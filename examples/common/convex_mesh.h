/* Meshes of convex polyhedra for examples and tests: a box cut by planes, its Voronoi cells. */
#ifndef CONVEX_MESH_H
#define CONVEX_MESH_H

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "dgfem.h"

enum { CONVEX_MESH_MAX = 4096 };

typedef struct convex_mesh {
    dgfem_polyhedron *cells[CONVEX_MESH_MAX];
    int count;
} convex_mesh;

/* splitmix64: lower <= result < upper */
static inline double convex_mesh_random(uint64_t *state, double lower, double upper) {
    uint64_t z = *state += 0x9e3779b97f4a7c15u;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return lower + (upper - lower) * (double)((z ^ (z >> 31)) >> 11) / 9007199254740992.0;
}

static inline dgfem_vec3 convex_mesh_vec3(double x, double y, double z) {
    dgfem_vec3 v;
    v.x = (dgfem_real)x, v.y = (dgfem_real)y, v.z = (dgfem_real)z;
    return v;
}

static inline dgfem_plane convex_mesh_plane(double x, double y, double z, double offset) {
    dgfem_plane plane;
    plane.normal = convex_mesh_vec3(x, y, z), plane.offset = (dgfem_real)offset;
    return plane;
}

static inline dgfem_status convex_mesh_box(double lower, double upper, dgfem_polyhedron **out) {
    static const int loops[] = {0, 4, 6, 2, 1, 3, 7, 5, 0, 1, 5, 4, 2, 6, 7, 3, 0, 2, 3, 1, 4, 5, 7, 6};
    static const int starts[] = {0, 4, 8, 12, 16, 20, 24};
    dgfem_vec3 corners[8];
    dgfem_polyhedron_desc desc = dgfem_default_polyhedron_desc();
    for (int i = 0; i < 8; i++)
        corners[i] = convex_mesh_vec3(i & 1 ? upper : lower, i & 2 ? upper : lower, i & 4 ? upper : lower);
    desc.vertices = corners, desc.vertex_count = 8;
    desc.face_count = 6, desc.loop_start = starts, desc.loop_vertices = loops;
    return dgfem_polyhedron_create(&desc, out);
}

static inline void convex_mesh_free(convex_mesh *mesh) {
    while (mesh->count) dgfem_polyhedron_destroy(mesh->cells[--mesh->count]);
}

/* Splits all cells. */
static inline dgfem_status convex_mesh_cut(convex_mesh *mesh, dgfem_plane plane) {
    for (int k = mesh->count - 1; k >= 0; k--) {
        dgfem_polyhedron *below, *above;
        dgfem_status status = dgfem_polyhedron_split(mesh->cells[k], plane, &below, &above);
        if (status) return status;
        if (!below || !above || mesh->count == CONVEX_MESH_MAX) {
            dgfem_polyhedron_destroy(below);
            dgfem_polyhedron_destroy(above);
            continue;
        }
        dgfem_polyhedron_destroy(mesh->cells[k]);
        mesh->cells[k] = below;
        mesh->cells[mesh->count++] = above;
    }
    return DGFEM_OK;
}

/* Makes a mesh of the cells, which are freed. */
static inline dgfem_status convex_mesh_finish(convex_mesh *mesh, dgfem_status status, dgfem_mesh **out) {
    dgfem_weld_desc desc = dgfem_default_weld_desc();
    *out = NULL;
    if (!status)
        status = dgfem_mesh_create_polyhedra((const dgfem_polyhedron *const *)mesh->cells, mesh->count, &desc, out);
    convex_mesh_free(mesh);
    free(mesh);
    return status;
}

/* The unit cube cut by planes, all cells by each. */
static inline dgfem_status convex_mesh_planes(const dgfem_plane *planes, int count, dgfem_mesh **out) {
    convex_mesh *mesh = (convex_mesh *)calloc(1, sizeof *mesh);
    *out = NULL;
    if (!mesh) return DGFEM_ERROR_MEMORY;
    dgfem_status status = convex_mesh_box(0, 1, &mesh->cells[0]);
    mesh->count = !status;
    for (int k = 0; !status && k < count; k++) status = convex_mesh_cut(mesh, planes[k]);
    return convex_mesh_finish(mesh, status, out);
}

/* n^3 hexahedra between planes that are askew, the most in the middle: opposite sides are not parallel. Meshes of one
   seed and different n are a family. */
static inline dgfem_status convex_mesh_hexahedra(int n, uint64_t seed, dgfem_mesh **out) {
    dgfem_plane planes[3 * 64];
    int count = 0;
    for (int axis = 0; axis < 3; axis++) {
        double slope[3];
        for (int i = 0; i < 3; i++) slope[i] = convex_mesh_random(&seed, 0.08, 0.16) * (i % 2 ? 1 : -1);
        for (int k = 1; k < n && k < 64; k++) {
            double t = (double)k / n, tilt[3], at = 0;
            for (int i = 0; i < 3; i++) tilt[i] = i == axis ? 1 : 4 * t * (1 - t) * slope[i];
            for (int i = 0; i < 3; i++) at += tilt[i] * (i == axis ? t : 0.5);
            planes[count++] = convex_mesh_plane(tilt[0], tilt[1], tilt[2], at);
        }
    }
    return convex_mesh_planes(planes, count, out);
}

/* The unit cube cut by planes through random points in random directions. */
static inline dgfem_status convex_mesh_random_planes(int count, uint64_t seed, dgfem_mesh **out) {
    dgfem_plane planes[64];
    for (int k = 0; k < count && k < 64; k++) {
        double z = convex_mesh_random(&seed, -1, 1), turn = convex_mesh_random(&seed, 0, 6.283185307179586);
        double r = sqrt(1 - z * z), x[3];
        for (int i = 0; i < 3; i++) x[i] = convex_mesh_random(&seed, 0.2, 0.8);
        planes[k] =
            convex_mesh_plane(r * cos(turn), r * sin(turn), z, r * cos(turn) * x[0] + r * sin(turn) * x[1] + z * x[2]);
    }
    return convex_mesh_planes(planes, count < 64 ? count : 64, out);
}

/* Voronoi cells in the unit cube of n^3 points, random ones of a lattice's cells; jitter 0: the lattice of cubes, 1:
   anywhere in their cells. */
static inline dgfem_status convex_mesh_voronoi(int n, double jitter, uint64_t seed, dgfem_mesh **out) {
    int count = n * n * n;
    convex_mesh *mesh = (convex_mesh *)calloc(1, sizeof *mesh);
    double(*x)[3] = (double(*)[3])malloc((size_t)count * sizeof *x);
    dgfem_status status = mesh && x ? DGFEM_OK : DGFEM_ERROR_MEMORY;
    *out = NULL;
    for (int k = 0; !status && k < count; k++) {
        int at[3];
        at[0] = k % n, at[1] = k / n % n, at[2] = k / (n * n);
        for (int i = 0; i < 3; i++) x[k][i] = (at[i] + 0.5 + jitter * convex_mesh_random(&seed, -0.5, 0.5)) / n;
    }
    for (int k = 0; !status && k < count && k < CONVEX_MESH_MAX; k++) {
        status = convex_mesh_box(0, 1, &mesh->cells[k]);
        if (!status) mesh->count++;
        for (int j = 0; !status && j < count; j++) { /* keeps the side of k */
            double d[3], middle = 0, square = 0;
            for (int i = 0; i < 3; i++) {
                d[i] = x[j][i] - x[k][i];
                middle += d[i] * (x[j][i] + x[k][i]) / 2;
                square += d[i] * d[i];
            }
            if (j == k || square * n * n > 36) continue;
            dgfem_polyhedron *below, *above;
            status =
                dgfem_polyhedron_split(mesh->cells[k], convex_mesh_plane(d[0], d[1], d[2], middle), &below, &above);
            if (status) break;
            dgfem_polyhedron_destroy(above);
            dgfem_polyhedron_destroy(mesh->cells[k]);
            mesh->cells[k] = below;
        }
    }
    free(x);
    if (mesh) return convex_mesh_finish(mesh, status, out);
    return status;
}

#endif
