/* Bodies of polyhedra for tests, and what to ask of them. Include it after dgfem_mvc.h. */
#ifndef CHECK_MVC_H
#define CHECK_MVC_H

#include "check.h"
#include "convex_mesh.h"

/* 1 Pa, Poisson's ratio 0.3, 1 kg/m^3, no gravity. */
static inline dgfem_mvc_desc mvc_desc(void) {
    dgfem_mvc_desc desc = dgfem_default_mvc_desc();
    desc.material.young = 1;
    desc.material.density = 1;
    desc.gravity = vec3(0, 0, 0);
    return desc;
}

/* A body of this mesh, which is destroyed. */
static inline dgfem_mvc *mvc_of(const dgfem_mvc_desc *base, dgfem_mesh *mesh) {
    dgfem_mvc_desc desc = *base;
    dgfem_mvc *body = NULL;
    desc.mesh = mesh;
    check_status(dgfem_mvc_create(&desc, &body), DGFEM_OK);
    dgfem_mesh_destroy(mesh);
    return body;
}

static inline dgfem_mesh *mvc_grid(int nx, int ny, int nz, double lx, double ly, double lz) {
    dgfem_grid_desc desc = dgfem_default_grid_desc();
    dgfem_mesh *mesh = NULL;
    desc.cells[0] = nx, desc.cells[1] = ny, desc.cells[2] = nz;
    desc.lower = vec3(0, 0, 0);
    desc.upper = vec3(lx, ly, lz);
    check_status(dgfem_mesh_create_grid(&desc, &mesh), DGFEM_OK);
    return mesh;
}

/* Kinds of meshes of the unit cube. */
typedef enum mvc_kind { MVC_CUBE, MVC_HEX, MVC_VORONOI, MVC_PLANES, MVC_TETRAHEDRA, MVC_KINDS } mvc_kind;

/* Five tetrahedra. */
static inline dgfem_mesh *mvc_tetrahedra(void) {
    static const int corners[] = {0, 1, 2, 4, 1, 2, 4, 7, 1, 3, 2, 7, 1, 4, 5, 7, 2, 4, 7, 6};
    dgfem_tetrahedra_desc desc = dgfem_default_tetrahedra_desc();
    dgfem_mesh *mesh = NULL;
    double points[24];
    int tetrahedra[20];
    for (int i = 0; i < 8; i++) points[3 * i] = i & 1, points[3 * i + 1] = i >> 1 & 1, points[3 * i + 2] = i >> 2 & 1;
    for (int t = 0; t < 5; t++) { /* positively oriented */
        const double *p[4];
        double d[3][3], det;
        for (int i = 0; i < 4; i++) p[i] = points + 3 * (tetrahedra[4 * t + i] = corners[4 * t + i]);
        for (int i = 0; i < 9; i++) d[i / 3][i % 3] = p[1 + i / 3][i % 3] - p[0][i % 3];
        det = d[0][0] * (d[1][1] * d[2][2] - d[1][2] * d[2][1]) - d[0][1] * (d[1][0] * d[2][2] - d[1][2] * d[2][0]) +
              d[0][2] * (d[1][0] * d[2][1] - d[1][1] * d[2][0]);
        if (det < 0) tetrahedra[4 * t + 2] = corners[4 * t + 3], tetrahedra[4 * t + 3] = corners[4 * t + 2];
    }
    desc.vertices = dgfem_points_in_double(points, 8);
    desc.tetrahedra = tetrahedra, desc.tetrahedron_count = 5;
    check_status(dgfem_mesh_create_tetrahedra(&desc, &mesh), DGFEM_OK);
    return mesh;
}

/* One regular octahedron. */
static inline dgfem_mesh *mvc_octahedron(void) {
    static const int loops[] = {0, 1, 2, 1, 3, 2, 3, 4, 2, 4, 0, 2, 1, 0, 5, 3, 1, 5, 4, 3, 5, 0, 4, 5};
    static const int starts[] = {0, 3, 6, 9, 12, 15, 18, 21, 24};
    dgfem_polyhedron_desc desc = dgfem_default_polyhedron_desc();
    dgfem_weld_desc weld = dgfem_default_weld_desc();
    dgfem_polyhedron *cell = NULL;
    dgfem_mesh *mesh = NULL;
    dgfem_vec3 x[6];
    x[0] = vec3(1, 0, 0), x[1] = vec3(0, 1, 0), x[2] = vec3(0, 0, 1);
    x[3] = vec3(-1, 0, 0), x[4] = vec3(0, -1, 0), x[5] = vec3(0, 0, -1);
    desc.vertices = x, desc.vertex_count = 6;
    desc.face_count = 8, desc.loop_start = starts, desc.loop_vertices = loops;
    check_status(dgfem_polyhedron_create(&desc, &cell), DGFEM_OK);
    check_status(dgfem_mesh_create_polyhedra((const dgfem_polyhedron *const *)&cell, 1, &weld, &mesh), DGFEM_OK);
    dgfem_polyhedron_destroy(cell);
    return mesh;
}

static inline dgfem_mesh *mvc_mesh(mvc_kind kind, int n, uint64_t seed) {
    dgfem_mesh *mesh = NULL;
    if (kind == MVC_CUBE) return mvc_grid(n, n, n, 1, 1, 1);
    if (kind == MVC_TETRAHEDRA) return mvc_tetrahedra();
    if (kind == MVC_HEX) check_status(convex_mesh_hexahedra(n, seed, &mesh), DGFEM_OK);
    if (kind == MVC_VORONOI) check_status(convex_mesh_voronoi(n, 1, seed, &mesh), DGFEM_OK);
    if (kind == MVC_PLANES) check_status(convex_mesh_random_planes(2 * n, seed, &mesh), DGFEM_OK);
    return mesh;
}

static inline int *mvc_boundary(const dgfem_mvc *body, int *count) {
    int *nodes = (int *)malloc((size_t)body->node_count * sizeof(int));
    assert_non_null(nodes);
    *count = dgfem_mvc_boundary_nodes(body, nodes, body->node_count);
    assert_in_range(*count, 4, body->node_count);
    return nodes;
}

/* u(x) = offset + linear x */
typedef struct mvc_affine {
    dgfem_mat3 linear;
    dgfem_vec3 offset;
} mvc_affine;

static inline mvc_affine mvc_random_affine(check_random *random, double size) {
    mvc_affine a;
    for (int i = 0; i < 9; i++) a.linear.m[i / 3][i % 3] = (dgfem_real)check_random_real(random, -size, size);
    a.offset = check_random_vec3(random, -size, size);
    return a;
}

static inline dgfem_vec3 mvc_affine_at(const mvc_affine *a, dgfem_vec3 x) {
    const dgfem_mat3 *m = &a->linear;
    return vec3((double)(a->offset.x + m->m[0][0] * x.x + m->m[0][1] * x.y + m->m[0][2] * x.z),
                (double)(a->offset.y + m->m[1][0] * x.x + m->m[1][1] * x.y + m->m[1][2] * x.z),
                (double)(a->offset.z + m->m[2][0] * x.x + m->m[2][1] * x.y + m->m[2][2] * x.z));
}

/* A rotation about an axis. */
static inline dgfem_mat3 mvc_rotation(double x, double y, double z, double angle) {
    double length = sqrt(x * x + y * y + z * z), a[3], c = cos(angle), s = sin(angle);
    dgfem_mat3 r;
    a[0] = x / length, a[1] = y / length, a[2] = z / length;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double cross = i == j ? 0 : (j - i + 3) % 3 == 1 ? -a[3 - i - j] : a[3 - i - j];
            r.m[i][j] = (dgfem_real)((i == j ? c : 0) + (1 - c) * a[i] * a[j] + s * cross);
        }
    return r;
}

#endif
