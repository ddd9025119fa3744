/* Skins and surfaces of polyhedral bodies; what a body keeps when its mesh is edited. */
#define DGFEM_IMPLEMENTATION
#include "dgfem_mvc.h"
#include "check_mvc.h"

static dgfem_mvc_skin *skin_of(const dgfem_mvc *body, const dgfem_vec3 *points, int count) {
    dgfem_mvc_skin_desc desc = dgfem_default_mvc_skin_desc();
    dgfem_mvc_skin *skin = NULL;
    desc.vertices = dgfem_points_in_vec3(points, count);
    check_status(dgfem_mvc_skin_create(body, &desc, &skin), DGFEM_OK);
    return skin;
}

static void move_affinely(dgfem_mvc *body, const mvc_affine *field) {
    dgfem_vec3 *x = (dgfem_vec3 *)malloc((size_t)body->node_count * sizeof *x);
    assert_non_null(x);
    for (int i = 0; i < body->node_count; i++) x[i] = mvc_affine_at(field, body->rest[i]);
    check_status(dgfem_mvc_set_positions(body, dgfem_points_in_vec3(x, body->node_count)), DGFEM_OK);
    free(x);
}

static void move_randomly(dgfem_mvc *body, check_random *random, double size) {
    dgfem_vec3 *x = (dgfem_vec3 *)malloc((size_t)body->node_count * sizeof *x);
    assert_non_null(x);
    for (int i = 0; i < body->node_count; i++) {
        dgfem_vec3 d = check_random_vec3(random, -size, size), r = body->rest[i];
        x[i] = vec3((double)(r.x + d.x), (double)(r.y + d.y), (double)(r.z + d.z));
    }
    check_status(dgfem_mvc_set_positions(body, dgfem_points_in_vec3(x, body->node_count)), DGFEM_OK);
    free(x);
}

static dgfem_mvc_skin *smooth_skin_of(const dgfem_mvc *body, const dgfem_vec3 *points, int count) {
    dgfem_mvc_skin_desc desc = dgfem_default_mvc_skin_desc();
    dgfem_mvc_skin *skin = NULL;
    desc.vertices = dgfem_points_in_vec3(points, count);
    desc.kind = DGFEM_MVC_SKIN_MLS;
    check_status(dgfem_mvc_skin_create(body, &desc, &skin), DGFEM_OK);
    return skin;
}

/* ---- skins ---- */

/* Affine motions are followed exactly, inside and outside; at rest nothing moves. */
static void test_affine(void **state) {
    (void)state;
    enum { N = 400 };
    check_random random = check_random_seeded(21);
    for (int kind = MVC_CUBE; kind < MVC_KINDS; kind++) {
        dgfem_mvc_desc desc = mvc_desc();
        dgfem_mvc *body = mvc_of(&desc, mvc_mesh((mvc_kind)kind, 3, 3));
        dgfem_vec3 points[N];
        int inside = 0;
        mvc_affine field = mvc_random_affine(&random, 1);
        for (int v = 0; v < N; v++) points[v] = check_random_vec3(&random, -0.3, 1.3);
        dgfem_mvc_skin *skin = skin_of(body, points, N);
        for (int v = 0; v < N; v++) {
            dgfem_vec3 p = points[v];
            int in = p.x > 0 && p.y > 0 && p.z > 0 && p.x < 1 && p.y < 1 && p.z < 1;
            double sum = 0;
            for (int i = skin->weight_start[v]; i < skin->weight_start[v + 1]; i++) {
                sum += (double)skin->weight[i];
                assert_true(!in || (double)skin->weight[i] > -100 * CHECK_EPSILON);
            }
            inside += in;
            check_near(sum, 1, 100 * CHECK_EPSILON);
            check_near3(skin->positions[v], p, 100 * CHECK_EPSILON);
        }
        assert_in_range(inside, 60, 200);
        move_affinely(body, &field);
        check_status(dgfem_mvc_skin_update(skin, body), DGFEM_OK);
        for (int v = 0; v < N; v++)
            check_near3(skin->positions[v], mvc_affine_at(&field, points[v]), 1e4 * CHECK_EPSILON);
        dgfem_mvc_skin_destroy(skin);
        dgfem_mvc_destroy(body);
    }
}

/* ---- skins by moving least squares ---- */

/* Affine motions are followed exactly, inside and outside. */
static void test_smooth_affine(void **state) {
    (void)state;
    enum { N = 300 };
    check_random random = check_random_seeded(31);
    for (int kind = MVC_CUBE; kind < MVC_KINDS; kind++) {
        dgfem_mvc_desc desc = mvc_desc();
        dgfem_mvc *body = mvc_of(&desc, mvc_mesh((mvc_kind)kind, 3, 3));
        dgfem_vec3 points[N];
        mvc_affine field = mvc_random_affine(&random, 1);
        for (int v = 0; v < N; v++) points[v] = check_random_vec3(&random, -0.2, 1.2);
        dgfem_mvc_skin *skin = smooth_skin_of(body, points, N);
        assert_int_equal(skin->kind, DGFEM_MVC_SKIN_MLS);
        for (int v = 0; v < N; v++) {
            double sum = 0;
            for (int i = skin->weight_start[v]; i < skin->weight_start[v + 1]; i++) sum += (double)skin->weight[i];
            assert_true(skin->weight_start[v + 1] - skin->weight_start[v] >= 4);
            check_near(sum, 1, 200 * CHECK_EPSILON);
            check_near3(skin->positions[v], points[v], 200 * CHECK_EPSILON);
        }
        move_affinely(body, &field);
        check_status(dgfem_mvc_skin_update(skin, body), DGFEM_OK);
        for (int v = 0; v < N; v++)
            check_near3(skin->positions[v], mvc_affine_at(&field, points[v]), 4000 * CHECK_EPSILON);
        dgfem_mvc_skin_destroy(skin);
        dgfem_mvc_destroy(body);
    }
}

/* The largest second derivative, by differences, of a skin along a line through the body. */
static double bend_of_skin(const dgfem_mvc *body, int is_smooth, int parts, dgfem_vec3 a, dgfem_vec3 b) {
    dgfem_vec3 *points = (dgfem_vec3 *)malloc((size_t)(parts + 1) * sizeof *points);
    double most = 0;
    assert_non_null(points);
    for (int k = 0; k <= parts; k++) {
        double t = (double)k / parts;
        points[k] = vec3((1 - t) * (double)a.x + t * (double)b.x, (1 - t) * (double)a.y + t * (double)b.y,
                         (1 - t) * (double)a.z + t * (double)b.z);
    }
    dgfem_mvc_skin *skin = is_smooth ? smooth_skin_of(body, points, parts + 1) : skin_of(body, points, parts + 1);
    for (int k = 1; k < parts; k++) {
        const dgfem_vec3 *x = skin->positions + k;
        double d[3];
        d[0] = (double)x[-1].x + (double)x[1].x - 2 * (double)x[0].x;
        d[1] = (double)x[-1].y + (double)x[1].y - 2 * (double)x[0].y;
        d[2] = (double)x[-1].z + (double)x[1].z - 2 * (double)x[0].z;
        most = fmax(most, sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) * parts * parts);
    }
    dgfem_mvc_skin_destroy(skin);
    free(points);
    return most;
}

/* Mean values kink where the line goes from one element to the next: the second difference grows as the steps shrink.
   Moving least squares have a second derivative. Float's round-off hides it. */
static void test_smoothness(void **state) {
    (void)state;
    check_random random = check_random_seeded(32);
    for (int kind = MVC_CUBE; kind < MVC_KINDS && !DGFEM_REAL_IS_FLOAT; kind++) {
        dgfem_mvc_desc desc = mvc_desc();
        dgfem_mvc *body = mvc_of(&desc, mvc_mesh((mvc_kind)kind, 3, 3));
        dgfem_vec3 a = vec3(0.07, 0.11, 0.05), b = vec3(0.93, 0.87, 0.96);
        move_randomly(body, &random, 0.1);
        double smooth = bend_of_skin(body, 1, 500, a, b), finer = bend_of_skin(body, 1, 2000, a, b);
        double rough = bend_of_skin(body, 0, 500, a, b), rougher = bend_of_skin(body, 0, 2000, a, b);
        print_message("%d elements: second differences %.3g, %.3g; of mean values %.3g, %.3g\n", body->element_count,
                      smooth, finer, rough, rougher);
        assert_true(finer < 1.05 * smooth);
        assert_true(rougher > rough && rougher > 100 * finer);
        dgfem_mvc_destroy(body);
    }
}

/* side[node]: bit 0 where it is in elements above z = 0.5, bit 1 below. */
static void sides_of_nodes(const dgfem_mvc *body, char *side) {
    int nodes[64];
    memset(side, 0, (size_t)body->node_count);
    for (int e = 0; e < body->element_count; e++) {
        int count = dgfem_mvc_element_nodes(body, e, nodes, 64);
        assert_in_range(count, 4, 64);
        for (int i = 0; i < count; i++) side[nodes[i]] |= (double)body->centre[e].z > 0.5 ? 1 : 2;
    }
}

/* The weight that a vertex takes from nodes of one side only. */
static double weight_from(const dgfem_mvc_skin *skin, int v, const char *side, char which) {
    double sum = 0;
    for (int i = skin->weight_start[v]; i < skin->weight_start[v + 1]; i++)
        if (side[skin->weight_node[i]] == which) sum += fabs((double)skin->weight[i]);
    return sum;
}

/* Nothing comes across a cut. Around the front of one that ends inside, weight grows continuously, from nothing. */
static void test_smooth_cuts(void **state) {
    (void)state;
    enum { N = 501 };
    dgfem_vec3 line[N], corners[4];
    for (int v = 0; v < N; v++) line[v] = vec3(2.0 * v / (N - 1), 0.4, 0.52);
    for (int k = 0; k < 4; k++) corners[k] = vec3(k == 1 || k == 2 ? 1.25 : -1, k < 2 ? -1 : 2, 0.5);
    for (int whole = 0; whole < 2; whole++) {
        dgfem_mvc_desc desc = mvc_desc();
        dgfem_mvc *body = mvc_of(&desc, mvc_grid(8, 4, 4, 2, 1, 1));
        dgfem_plane plane = {{0, 0, 1}, DGFEM_R(0.5)};
        char side[1024];
        dgfem_mvc_skin *skin = smooth_skin_of(body, line, N);
        assert_true(weight_from(skin, 0, (sides_of_nodes(body, side), side), 2) > 0.1);
        if (whole) check_status(dgfem_mvc_cut_plane(body, plane, NULL, NULL), DGFEM_OK);
        else check_status(dgfem_mvc_cut_polygon(body, dgfem_points_in_vec3(corners, 4), NULL, NULL), DGFEM_OK);
        check_status(dgfem_mvc_skin_update(skin, body), DGFEM_ERROR_REVISION);
        check_status(dgfem_mvc_skin_renew(skin, body), DGFEM_OK);
        assert_int_equal(skin->kind, DGFEM_MVC_SKIN_MLS);
        assert_in_range(body->node_count, 1, (int)sizeof side);
        sides_of_nodes(body, side);
        for (int v = 0; v < N; v++) {
            double x = 2.0 * v / (N - 1), across = weight_from(skin, v, side, 2);
            if (whole || x < 0.4) check_near(across, 0, 0);
            if (v) check_near(across, weight_from(skin, v - 1, side, 2), 0.05);
            if (!whole && x > 1.5) assert_true(across > 0.1);
        }
        dgfem_mvc_skin_destroy(skin);
        dgfem_mvc_destroy(body);
    }
}

/* Flat bodies, and one element alone. */
static void test_smooth_extremes(void **state) {
    (void)state;
    check_random random = check_random_seeded(33);
    for (int thin = 0; thin < 3; thin++) {
        dgfem_mvc_desc desc = mvc_desc();
        double height = thin == 0 ? 1e-2 : thin == 2 ? 1 : DGFEM_REAL_IS_FLOAT ? 1e-3 : 1e-6;
        dgfem_mvc *body = mvc_of(&desc, mvc_grid(thin < 2 ? 2 : 1, 1, 1, 1, 1, height));
        dgfem_vec3 points[20];
        mvc_affine field = mvc_random_affine(&random, 1);
        for (int v = 0; v < 20; v++) {
            points[v] = check_random_vec3(&random, -2, 3);
            points[v].z *= (dgfem_real)height;
        }
        dgfem_mvc_skin *skin = smooth_skin_of(body, points, 20);
        move_affinely(body, &field);
        check_status(dgfem_mvc_skin_update(skin, body), DGFEM_OK);
        for (int v = 0; v < 20; v++)
            check_near3(skin->positions[v], mvc_affine_at(&field, points[v]), 1e5 * CHECK_EPSILON);
        dgfem_mvc_skin_destroy(skin);
        dgfem_mvc_destroy(body);
    }
}

/* ---- continuity and distance of mean values ---- */

/* Vertices at nodes follow them, those on edges and triangles linearly. Just beside an inner or outer face the skin
   moves as on it: there is no jump. */
static void test_continuity(void **state) {
    (void)state;
    check_random random = check_random_seeded(22);
    for (int kind = MVC_CUBE; kind < MVC_KINDS; kind++) {
        dgfem_mvc_desc desc = mvc_desc();
        dgfem_mvc *body = mvc_of(&desc, mvc_mesh((mvc_kind)kind, 2, 3));
        dgfem_vec3 *points = (dgfem_vec3 *)malloc((size_t)(3 * body->face_count + body->node_count) * sizeof *points);
        double beside = DGFEM_REAL_IS_FLOAT ? 1e-5 : 1e-9;
        int n = 0, triangle[3 * 64];
        assert_non_null(points);
        for (int f = 0; f < body->face_count; f++) {
            assert_in_range(dgfem_mvc_face_triangles(body, f, triangle, 64), 1, 64);
            dgfem_vec3 a = body->rest[triangle[0]], b = body->rest[triangle[1]], c = body->rest[triangle[2]];
            double x = (double)(a.x + b.x + 2 * c.x) / 4, y = (double)(a.y + b.y + 2 * c.y) / 4;
            double z = (double)(a.z + b.z + 2 * c.z) / 4;
            dgfem_vec3 d = check_random_vec3(&random, -beside, beside);
            points[n++] = vec3(x, y, z);
            points[n++] = vec3(x + (double)d.x, y + (double)d.y, z + (double)d.z);
            points[n++] = vec3(x - (double)d.x, y - (double)d.y, z - (double)d.z);
        }
        for (int i = 0; i < body->node_count; i++) points[n++] = body->rest[i];
        dgfem_mvc_skin *skin = skin_of(body, points, n);
        move_randomly(body, &random, 0.2);
        check_status(dgfem_mvc_skin_update(skin, body), DGFEM_OK);
        for (int f = 0; f < body->face_count; f++) {
            (void)dgfem_mvc_face_triangles(body, f, triangle, 64);
            dgfem_vec3 a = body->position[triangle[0]], b = body->position[triangle[1]],
                       c = body->position[triangle[2]];
            dgfem_vec3 x = vec3((double)(a.x + b.x + 2 * c.x) / 4, (double)(a.y + b.y + 2 * c.y) / 4,
                                (double)(a.z + b.z + 2 * c.z) / 4);
            check_near3(skin->positions[3 * f], x, 200 * CHECK_EPSILON);
            check_near3(skin->positions[3 * f + 1], x, 1e4 * beside);
            check_near3(skin->positions[3 * f + 2], x, 1e4 * beside);
        }
        for (int i = 0; i < body->node_count; i++)
            check_near3(skin->positions[3 * body->face_count + i], body->position[i], 20 * CHECK_EPSILON);
        free(points);
        dgfem_mvc_skin_destroy(skin);
        dgfem_mvc_destroy(body);
    }
}

/* Far outside too the vertex belongs to the nearest point, and a rigid motion carries it along. */
static void test_far_outside(void **state) {
    (void)state;
    dgfem_mvc_desc desc = mvc_desc();
    dgfem_mvc *body = mvc_of(&desc, mvc_grid(2, 1, 1, 2, 1, 1));
    dgfem_vec3 points[2];
    mvc_affine field;
    points[0] = vec3(1.75, 0.5, 9), points[1] = vec3(-30, 0.25, 0.25);
    dgfem_mvc_skin *skin = skin_of(body, points, 2);
    assert_int_equal(skin->element[0], 1);
    assert_int_equal(skin->element[1], 0);
    field.linear = mvc_rotation(1, 2, 3, 2);
    field.offset = vec3(1, 2, 3);
    move_affinely(body, &field);
    check_status(dgfem_mvc_skin_update(skin, body), DGFEM_OK);
    for (int v = 0; v < 2; v++) check_near3(skin->positions[v], mvc_affine_at(&field, points[v]), 1e3 * CHECK_EPSILON);
    dgfem_mvc_skin_destroy(skin);
    dgfem_mvc_destroy(body);
}

/* ---- surfaces ---- */

static double surface_volume(const dgfem_mvc_surface *surface) {
    double volume = 0;
    for (int t = 0; t < surface->triangle_count; t++) {
        double p[3][3];
        for (int i = 0; i < 3; i++) {
            dgfem_vec3 x = surface->positions[surface->triangles[3 * t + i]];
            p[i][0] = (double)x.x, p[i][1] = (double)x.y, p[i][2] = (double)x.z;
        }
        volume +=
            (p[0][0] * (p[1][1] * p[2][2] - p[1][2] * p[2][1]) - p[0][1] * (p[1][0] * p[2][2] - p[1][2] * p[2][0]) +
             p[0][2] * (p[1][0] * p[2][1] - p[1][1] * p[2][0])) /
            6;
    }
    return volume;
}

/* Closed: each directed edge, by nodes, once, and its opposite once. */
static void check_closed_surface(const dgfem_mvc_surface *surface) {
    for (int t = 0; t < 3 * surface->triangle_count; t++) {
        int a = surface->node[surface->triangles[t]], same = 0, opposite = 0;
        int b = surface->node[surface->triangles[t - t % 3 + (t + 1) % 3]];
        for (int s = 0; s < 3 * surface->triangle_count; s++) {
            int c = surface->node[surface->triangles[s]];
            int d = surface->node[surface->triangles[s - s % 3 + (s + 1) % 3]];
            same += a == c && b == d, opposite += a == d && b == c;
        }
        assert_int_equal(same, 1);
        assert_int_equal(opposite, 1);
    }
}

/* A cube's has sharp edges and flat sides; an octahedron's too (its faces meet by 70 degrees); both are closed and hold
   the volume, also when turned. */
static void test_surface(void **state) {
    (void)state;
    for (int kind = 0; kind <= MVC_KINDS; kind++) {
        dgfem_mvc_desc desc = mvc_desc();
        dgfem_mvc *body = mvc_of(&desc, kind < MVC_KINDS ? mvc_mesh((mvc_kind)kind, 2, 3) : mvc_octahedron());
        dgfem_mvc_surface *surface;
        mvc_affine field;
        check_status(dgfem_mvc_surface_create(body, &surface), DGFEM_OK);
        check_closed_surface(surface);
        field.linear = mvc_rotation(1, 2, 3, 0.7);
        field.offset = vec3(1, 2, 3);
        move_affinely(body, &field);
        check_status(dgfem_mvc_surface_update(surface, body), DGFEM_OK);
        check_near(surface_volume(surface), kind < MVC_KINDS ? 1 : 4.0 / 3, 1e3 * CHECK_EPSILON);
        check_near(dgfem_mvc_volume(body), surface_volume(surface), 1e3 * CHECK_EPSILON);
        if (kind == MVC_CUBE) assert_int_equal(surface->vertex_count, 6 * 9);
        if (kind == MVC_KINDS) assert_int_equal(surface->vertex_count, 24);
        for (int t = 0; t < surface->triangle_count; t++) { /* flat sides: normals are the triangles' */
            dgfem_vec3 p[3];
            for (int i = 0; i < 3; i++) p[i] = surface->positions[surface->triangles[3 * t + i]];
            double a[3], b[3], n[3], length;
            a[0] = (double)(p[1].x - p[0].x), a[1] = (double)(p[1].y - p[0].y), a[2] = (double)(p[1].z - p[0].z);
            b[0] = (double)(p[2].x - p[0].x), b[1] = (double)(p[2].y - p[0].y), b[2] = (double)(p[2].z - p[0].z);
            for (int i = 0; i < 3; i++) n[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
            length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
            if (length < 1e-4) continue;
            for (int i = 0; i < 3; i++)
                check_near3(surface->normals[surface->triangles[3 * t + i]],
                            vec3(n[0] / length, n[1] / length, n[2] / length), DGFEM_REAL_IS_FLOAT ? 1e-2 : 1e-10);
        }
        dgfem_mvc_surface_destroy(surface);
        dgfem_mvc_destroy(body);
    }
}

/* ---- edits ---- */

static dgfem_status cut(dgfem_mvc *body, dgfem_plane plane, int split) {
    dgfem_mvc_cut_desc desc = dgfem_default_mvc_cut_desc();
    dgfem_mvc_cut_info info;
    desc.current = 0;
    desc.remove_slivers = 0;
    dgfem_status status =
        split ? dgfem_mvc_split_plane(body, plane, &desc, &info) : dgfem_mvc_cut_plane(body, plane, &desc, &info);
    if (!status) assert_true(info.elements_split > 0);
    return status;
}

/* Loads, fixtures, mass, momentum stay where they are; the state is interpolated. */
static void test_edit_keeps(void **state) {
    (void)state;
    for (int split = 0; split < 2; split++) {
        dgfem_mvc_desc desc = mvc_desc();
        dgfem_mvc *body = mvc_of(&desc, mvc_mesh(MVC_HEX, 3, 3));
        int nodes[256], faces[256], fix, traction, force, pin, before = body->element_count;
        int corner = dgfem_mvc_nearest_node(body, vec3(1, 1, 1));
        mvc_affine field, flow;
        check_random random = check_random_seeded(23);
        dgfem_vec3 linear[2], angular[2], sums[2];
        int count = dgfem_mvc_nodes_on_plane(body, convex_mesh_plane(1, 0, 0, 0), (dgfem_real)1e-4, nodes, 256);
        check_status(dgfem_mvc_fix_nodes(body, nodes, count, DGFEM_MVC_XYZ, vec3(0, 0, 0), &fix), DGFEM_OK);
        count = dgfem_mvc_faces_on_plane(body, convex_mesh_plane(1, 0, 0, 1), (dgfem_real)1e-4, faces, 256);
        check_status(dgfem_mvc_set_traction(body, faces, count, vec3(0.1, 0, 0.2), &traction), DGFEM_OK);
        check_status(dgfem_mvc_add_force(body, &corner, 1, vec3(0, 0.3, 0), &force), DGFEM_OK);
        check_status(dgfem_mvc_pin(body, corner, 2, &pin), DGFEM_OK);
        field = mvc_random_affine(&random, 1), flow = mvc_random_affine(&random, 1);
        move_affinely(body, &field);
        dgfem_vec3 *v = (dgfem_vec3 *)malloc((size_t)body->node_count * sizeof *v);
        assert_non_null(v);
        for (int i = 0; i < body->node_count; i++) v[i] = mvc_affine_at(&flow, body->rest[i]);
        check_status(dgfem_mvc_set_velocities(body, dgfem_points_in_vec3(v, body->node_count)), DGFEM_OK);
        free(v);
        for (int k = 0; k < 2; k++) {
            dgfem_vec3 *f = (dgfem_vec3 *)malloc((size_t)body->node_count * sizeof *f);
            assert_non_null(f);
            check_status(dgfem_mvc_momentum(body, &linear[k], &angular[k]), DGFEM_OK);
            check_status(dgfem_mvc_external_force(body, f), DGFEM_OK);
            sums[k] = vec3(0, 0, 0);
            for (int i = 0; i < body->node_count; i++)
                sums[k] =
                    vec3((double)(sums[k].x + f[i].x), (double)(sums[k].y + f[i].y), (double)(sums[k].z + f[i].z));
            free(f);
            if (!k) check_status(cut(body, convex_mesh_plane(0, 0.1, 1, 0.47), split), DGFEM_OK);
        }
        check_status(dgfem_mvc_check(body), DGFEM_OK);
        assert_int_equal(body->revision, 1);
        assert_true(body->element_count > before);
        check_near3(sums[0], vec3(0.1, 0.3, 0.2), 100 * CHECK_EPSILON);
        check_near3(sums[1], sums[0], 100 * CHECK_EPSILON);
        check_near3(linear[1], linear[0], 200 * CHECK_EPSILON);
        check_near(dgfem_mvc_mass(body), 1, 100 * CHECK_EPSILON);
        check_near(dgfem_mvc_rest_volume(body), 1, 100 * CHECK_EPSILON);
        for (int i = 0; i < body->node_count; i++) {
            check_near3(body->position[i], mvc_affine_at(&field, body->rest[i]), 100 * CHECK_EPSILON);
            check_near3(body->velocity[i], mvc_affine_at(&flow, body->rest[i]), 100 * CHECK_EPSILON);
        }
        count = dgfem_mvc_nodes_on_plane(body, convex_mesh_plane(1, 0, 0, 0), (dgfem_real)1e-4, nodes, 256);
        assert_int_equal(body->condition_count, 4);
        assert_int_equal(body->conditions[0].count, count); /* copies and nodes between held ones are held */
        check_near(body->conditions[3].share[0], 1, 0);
        for (int n = 0; n < 5; n++) check_status(dgfem_mvc_step(body, (dgfem_real)0.01, NULL), DGFEM_OK);
        for (int i = 0; i < count; i++) check_near3(body->position[nodes[i]], body->rest[nodes[i]], 20 * CHECK_EPSILON);
        dgfem_mvc_destroy(body);
    }
}

/* Kept integrals are those that a full integration gives. */
static void test_edit_integrals(void **state) {
    (void)state;
    dgfem_mvc_desc desc = mvc_desc();
    dgfem_mvc *body = mvc_of(&desc, mvc_mesh(MVC_VORONOI, 2, 3));
    check_status(cut(body, convex_mesh_plane(0.3, 0.1, 1, 0.6), 1), DGFEM_OK);
    check_status(cut(body, convex_mesh_plane(1, 0.1, -0.2, 0.55), 0), DGFEM_OK);
    dgfem_mvc fresh = *body;
    for (int e = 0; e < body->element_count; e++) body->mesh->elements[e].changed = 1;
    check_status(dgfem_mvci_build_topology(&fresh, NULL, body), DGFEM_OK);
    size_t n = 9 * body->system->pair_start[body->element_count];
    for (size_t i = 0; i < n; i++)
        check_near(body->system->stiffness[i], fresh.system->stiffness[i], 1e3 * CHECK_EPSILON);
    for (int i = 0; i < body->node_count; i++) check_near(body->mass[i], fresh.mass[i], 10 * CHECK_EPSILON);
    dgfem_mvci_free_topology(&fresh);
    dgfem_mvc_destroy(body);
}

/* With hanging nodes and open cracks the patch test holds: errors relative to the largest displacement. */
static void test_patch_after_cuts(void **state) {
    (void)state;
    check_random random = check_random_seeded(24);
    for (int m = 0; m < 6; m++) {
        dgfem_mvc_desc desc = mvc_desc();
        desc.quadrature = m % 2 ? DGFEM_MVC_PAPER : DGFEM_MVC_TET4;
        desc.warp = 0;
        desc.stabilisation = m < 3 ? 0 : (dgfem_real)0.1; /* cut Voronoi cells have very short edges */
        dgfem_mvc *body = mvc_of(&desc, mvc_mesh(m < 3 ? MVC_HEX : MVC_VORONOI, 2, (uint64_t)m));
        mvc_affine field = mvc_random_affine(&random, 1);
        double worst = 0, size = 0;
        int count, id;
        for (int k = 0; k < 3; k++) {
            dgfem_vec3 normal = check_random_vec3(&random, -1, 1);
            (void)cut(body,
                      convex_mesh_plane((double)normal.x, (double)normal.y, (double)normal.z,
                                        0.5 * (double)(normal.x + normal.y + normal.z)),
                      k < 2);
        }
        int *nodes = mvc_boundary(body, &count);
        check_status(dgfem_mvc_fix_nodes(body, nodes, count, DGFEM_MVC_XYZ, vec3(0, 0, 0), &id), DGFEM_OK);
        check_status(dgfem_mvc_move_fixture(body, id, field.linear, field.offset), DGFEM_OK);
        check_status(dgfem_mvc_solve_static(body, NULL, NULL), DGFEM_OK);
        for (int i = 0; i < body->node_count; i++) {
            dgfem_vec3 u = mvc_affine_at(&field, body->rest[i]), r = body->rest[i];
            size = fmax(size, check_distance(u, vec3(0, 0, 0)));
            worst = fmax(worst, check_distance(body->position[i],
                                               vec3((double)(r.x + u.x), (double)(r.y + u.y), (double)(r.z + u.z))));
        }
        print_message("%d elements, %d nodes: %.1e\n", body->element_count, body->node_count, worst / size);
        check_near(worst / size, 0, DGFEM_REAL_IS_FLOAT ? 1e-3 : 1e-12);
        free(nodes);
        dgfem_mvc_destroy(body);
    }
}

/* After an edit skins and surfaces must be renewed. */
static void test_revisions(void **state) {
    (void)state;
    check_host host;
    dgfem_mvc_desc desc = mvc_desc();
    dgfem_mvc_skin_desc skin_desc = dgfem_default_mvc_skin_desc();
    desc.hooks = check_hooks(&host);
    dgfem_mvc *body = mvc_of(&desc, mvc_grid(2, 2, 2, 1, 1, 1));
    dgfem_vec3 points[3];
    static const int triangle[] = {0, 1, 2};
    dgfem_mvc_skin *skin = NULL;
    dgfem_mvc_surface *surface = NULL;
    points[0] = vec3(0.1, 0.2, 0.9), points[1] = vec3(0.9, 0.2, 0.9), points[2] = vec3(0.5, 0.7, 0.9);
    skin_desc.vertices = dgfem_points_in_vec3(points, 3);
    skin_desc.triangles = triangle, skin_desc.triangle_count = 1;
    skin_desc.hooks = desc.hooks;
    check_status(dgfem_mvc_skin_create(body, &skin_desc, &skin), DGFEM_OK);
    check_status(dgfem_mvc_surface_create(body, &surface), DGFEM_OK);
    for (int v = 0; v < 3; v++) check_near3(skin->normals[v], vec3(0, 0, 1), 20 * CHECK_EPSILON);
    check_status(cut(body, convex_mesh_plane(0, 0, 1, 0.7), 0), DGFEM_OK);
    check_status(dgfem_mvc_skin_update(skin, body), DGFEM_ERROR_REVISION);
    check_logged(&host, "skin of revision 0");
    check_status(dgfem_mvc_surface_update(surface, body), DGFEM_ERROR_REVISION);
    check_logged(&host, "surface of revision 0");
    for (long fail = 1;; fail++) { /* all or nothing */
        int *element = skin->element;
        host.calls = 0, host.fail_from = fail, host.log_count = 0;
        dgfem_status status = dgfem_mvc_skin_renew(skin, body);
        host.fail_from = 0;
        if (!status) break;
        check_status(status, DGFEM_ERROR_MEMORY);
        check_logged(&host, "out of memory");
        assert_true(skin->element == element && skin->revision == 0);
    }
    check_status(dgfem_mvc_skin_update(skin, body), DGFEM_OK);
    for (int v = 0; v < 3; v++) check_near3(skin->positions[v], points[v], 20 * CHECK_EPSILON);
    dgfem_mvc_skin_destroy(skin);
    dgfem_mvc_surface_destroy(surface);
    dgfem_mvc_destroy(body);
    assert_int_equal(host.live, 0);
}

static dgfem_status run_skin(void *context, const dgfem_hooks *hooks) {
    dgfem_mvc_skin_desc desc = dgfem_default_mvc_skin_desc();
    dgfem_vec3 points[3];
    static const int triangle[] = {0, 1, 2};
    dgfem_mvc_skin *skin = NULL;
    points[0] = vec3(0.1, 0.2, 0.9), points[1] = vec3(0.9, 0.2, 0.9), points[2] = vec3(0.5, 0.7, 2);
    desc.vertices = dgfem_points_in_vec3(points, 3);
    desc.triangles = triangle, desc.triangle_count = 1;
    desc.hooks = *hooks;
    dgfem_status status = dgfem_mvc_skin_create((const dgfem_mvc *)context, &desc, &skin);
    dgfem_mvc_skin_destroy(skin);
    return status;
}

static dgfem_status run_smooth_skin(void *context, const dgfem_hooks *hooks) {
    dgfem_mvc_skin_desc desc = dgfem_default_mvc_skin_desc();
    dgfem_vec3 points[2];
    dgfem_mvc_skin *skin = NULL;
    points[0] = vec3(0.1, 0.2, 0.9), points[1] = vec3(0.5, 0.7, 2);
    desc.kind = DGFEM_MVC_SKIN_MLS;
    desc.vertices = dgfem_points_in_vec3(points, 2);
    desc.hooks = *hooks;
    dgfem_status status = dgfem_mvc_skin_create((const dgfem_mvc *)context, &desc, &skin);
    dgfem_mvc_skin_destroy(skin);
    return status;
}

static dgfem_status run_surface(void *context, const dgfem_hooks *hooks) {
    dgfem_mvc body = *(const dgfem_mvc *)context;
    dgfem_mvc_surface *surface = NULL;
    body.hooks = *hooks;
    dgfem_status status = dgfem_mvc_surface_create(&body, &surface);
    dgfem_mvc_surface_destroy(surface);
    return status;
}

static void test_allocation_failures(void **state) {
    (void)state;
    dgfem_mvc_desc desc = mvc_desc();
    dgfem_mvc *body = mvc_of(&desc, mvc_mesh(MVC_HEX, 2, 3));
    (void)check_every_allocation(run_skin, body);
    assert_true(check_every_allocation(run_smooth_skin, body) > 20);
    (void)check_every_allocation(run_surface, body);
    dgfem_mvc_destroy(body);
}

static void test_bad_skins(void **state) {
    (void)state;
    check_host host;
    dgfem_mvc_desc desc = mvc_desc();
    dgfem_mvc *body = mvc_of(&desc, mvc_grid(1, 1, 1, 1, 1, 1));
    dgfem_vec3 points[3];
    int triangle[3];
    dgfem_mvc_skin *skin = NULL;
    dgfem_mvc_skin_desc good = dgfem_default_mvc_skin_desc(), bad;
    memset(points, 0, sizeof points);
    triangle[0] = 0, triangle[1] = 1, triangle[2] = 3;
    good.hooks = check_hooks(&host);
    good.vertices = dgfem_points_in_vec3(points, 3);
    check_status(dgfem_mvc_skin_create(body, NULL, &skin), DGFEM_ERROR_DESCRIPTOR);
    check_status(dgfem_mvc_skin_create(NULL, &good, &skin), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_mvc_skin_create(body, &good, NULL), DGFEM_ERROR_ARGUMENT);
    bad = good, bad.vertices.count = 0;
    check_status(dgfem_mvc_skin_create(body, &bad, &skin), DGFEM_ERROR_EMPTY);
    check_logged(&host, "no vertices");
    bad = good, bad.kind = (dgfem_mvc_skin_kind)7;
    check_status(dgfem_mvc_skin_create(body, &bad, &skin), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "unknown kind of skin 7");
    bad = good, bad.triangles = triangle, bad.triangle_count = 1;
    check_status(dgfem_mvc_skin_create(body, &bad, &skin), DGFEM_ERROR_INDEX);
    check_logged(&host, "triangle 0: vertex 3 of 3");
    bad = good, bad.triangle_count = 1;
    check_status(dgfem_mvc_skin_create(body, &bad, &skin), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "1 triangles");
    points[1].y = (dgfem_real)NAN;
    check_status(dgfem_mvc_skin_create(body, &good, &skin), DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "vertex 1");
    check_status(dgfem_mvc_surface_create(body, NULL), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_mvc_skin_update(NULL, body), DGFEM_ERROR_ARGUMENT);
    dgfem_mvc_skin_destroy(NULL);
    dgfem_mvc_surface_destroy(NULL);
    dgfem_mvc_destroy(body);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_affine),
        cmocka_unit_test(test_smooth_affine),
        cmocka_unit_test(test_smoothness),
        cmocka_unit_test(test_smooth_cuts),
        cmocka_unit_test(test_smooth_extremes),
        cmocka_unit_test(test_continuity),
        cmocka_unit_test(test_far_outside),
        cmocka_unit_test(test_surface),
        cmocka_unit_test(test_edit_keeps),
        cmocka_unit_test(test_edit_integrals),
        cmocka_unit_test(test_patch_after_cuts),
        cmocka_unit_test(test_revisions),
        cmocka_unit_test(test_allocation_failures),
        cmocka_unit_test(test_bad_skins),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
