/* Contact: areas, one contact by hand, the bound of the coupling, friction, shapes, a block on a slope. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "check.h"
#include "check_body.h"

static double dot(dgfem_vec3 a, dgfem_vec3 b) {
    return (double)a.x * (double)b.x + (double)a.y * (double)b.y + (double)a.z * (double)b.z;
}

/* nx * ny * nz unit cubes with one shape and a block matrix of their size. */
typedef struct scene {
    dgfem_body *body;
    dgfem_contacts *contacts;
    dgfem_matrix *matrix;
    dgfem_vec3 *b; /* [basis_count] */
} scene;

static dgfem_body *cubes(int nx, int ny, int nz, int degree) {
    dgfem_grid_desc desc = dgfem_default_grid_desc();
    dgfem_mesh *mesh;
    dgfem_body *body;
    desc.cells[0] = nx, desc.cells[1] = ny, desc.cells[2] = nz;
    desc.upper = vec3(nx, ny, nz);
    check_status(dgfem_mesh_create_grid(&desc, &mesh), DGFEM_OK);
    body = check_body_create(mesh, NULL, degree, NULL);
    body->shapes = (dgfem_shape *)calloc(2, sizeof *body->shapes);
    return body;
}

static dgfem_shape_desc shape_desc(void) {
    dgfem_shape_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.plane.normal = vec3(0, 0, 1);
    desc.radius = 1;
    desc.stiffness = 10;
    desc.damping = (dgfem_real)0.005;
    desc.friction = (dgfem_real)0.5;
    desc.slip_speed = (dgfem_real)1e-3;
    return desc;
}

static void add_shape(dgfem_body *body, dgfem_shape_kind kind, dgfem_shape_desc desc) {
    dgfem_shape *shape = &body->shapes[body->shape_count++];
    shape->kind = kind;
    shape->desc = desc;
}

/* Takes the body. Contact points: `count` given ones of area 0.1, or the corners where that is 0. */
static scene make_scene(dgfem_body *body, const dgfem_vec3 *points, int count) {
    scene s;
    int elements = body->mesh->element_count;
    int *sizes = (int *)calloc((size_t)elements, sizeof *sizes);
    dgfem_real *areas = (dgfem_real *)calloc((size_t)count + 1, sizeof *areas);
    dgfem_matrix_desc desc = dgfem_default_matrix_desc();
    dgfem_points_in in = dgfem_points_in_vec3(points, count);
    s.body = body;
    for (int i = 0; i < count; i++) areas[i] = (dgfem_real)0.1;
    check_status(dgfemi_contacts_create(body, count ? &in : NULL, count ? areas : NULL, &s.contacts), DGFEM_OK);
    for (int e = 0; e < elements; e++) sizes[e] = 3 * (body->basis_start[e + 1] - body->basis_start[e]);
    desc.block_count = elements, desc.block_sizes = sizes;
    check_status(dgfem_matrix_create(&desc, &s.matrix), DGFEM_OK);
    s.b = (dgfem_vec3 *)calloc((size_t)body->basis_count, sizeof *s.b);
    free(sizes);
    free(areas);
    return s;
}

static void free_scene(scene *s) {
    dgfemi_contacts_destroy(s->contacts);
    dgfem_matrix_destroy(s->matrix);
    check_body_destroy(s->body);
    free(s->b);
}

static int assemble(scene *s, double dt) {
    dgfem_matrix_clear(s->matrix);
    memset(s->b, 0, (size_t)s->body->basis_count * sizeof *s->b);
    return dgfemi_contacts_assemble(s->contacts, s->body, (dgfem_real)dt, s->matrix, s->b);
}

/* y = A x - b, from the diagonal blocks, in double. */
static void residual(const scene *s, const dgfem_vec3 *x, double *y) {
    for (int e = 0; e < s->body->mesh->element_count; e++) {
        int start = s->body->basis_start[e], n = 3 * (s->body->basis_start[e + 1] - start);
        const dgfem_real *block = dgfem_matrix_block(s->matrix, e, e);
        for (int i = 0; i < n; i++) {
            const dgfem_vec3 *b = &s->b[start + i / 3];
            double sum = -(double)(i % 3 == 0 ? b->x : i % 3 == 1 ? b->y : b->z);
            for (int j = 0; j < n; j++) {
                const dgfem_vec3 *v = &x[start + j / 3];
                sum += (double)block[i * n + j] * (double)(j % 3 == 0 ? v->x : j % 3 == 1 ? v->y : v->z);
            }
            y[3 * start + i] = sum;
        }
    }
}

/* The row W of a contact point, from the embedding's own arrays. */
static void row_of(const scene *s, int point, double *row) {
    const dgfem_embedding *m = s->contacts->embedding;
    for (int i = 0; i < s->body->basis_count; i++) row[i] = 0;
    for (int i = m->weight_start[point]; i < m->weight_start[point + 1]; i++) {
        int k = m->weight_sample[i], terms = m->term_start[k + 1] - m->term_start[k];
        for (int t = m->term_start[k]; t < m->term_start[k + 1]; t++)
            for (int j = m->term_basis_start[t]; j < m->term_basis_start[t + 1]; j++)
                row[s->body->basis_start[m->term_element[t]] + j - m->term_basis_start[t]] +=
                    (double)m->weight[i] / terms * (double)m->term_basis[j];
    }
}

static dgfem_vec3 row_times(const scene *s, const double *row, const dgfem_vec3 *x) {
    double sum[3] = {0, 0, 0};
    for (int i = 0; i < s->body->basis_count; i++)
        sum[0] += row[i] * (double)x[i].x, sum[1] += row[i] * (double)x[i].y, sum[2] += row[i] * (double)x[i].z;
    return vec3(sum[0], sum[1], sum[2]);
}

/* ---- contact points ---- */

static void test_corner_areas(void **state) {
    scene s = make_scene(cubes(2, 2, 2, 1), NULL, 0);
    double sum = 0;
    (void)state;
    assert_int_equal(s.contacts->embedding->point_count, 26); /* all vertices but the one inside */
    for (int i = 0; i < 26; i++) {
        dgfem_vec3 p = s.contacts->embedding->points[i];
        int ends = (p.x != 1) + (p.y != 1) + (p.z != 1);
        sum += (double)s.contacts->area[i];
        check_near(s.contacts->area[i], ends == 3 ? 0.75 : 1, 8 * CHECK_EPSILON); /* quarters of 3 or 4 unit squares */
    }
    check_near(sum, 24, 64 * CHECK_EPSILON);
    free_scene(&s);
}

/* A cut face has two sides, and both can touch. */
static void test_cut_faces_have_contact_points(void **state) {
    dgfem_body *body = cubes(2, 1, 1, 1);
    scene s;
    double sum = 0;
    (void)state;
    for (int f = 0; f < body->mesh->face_count; f++)
        if (body->mesh->faces[f].element[1] != DGFEM_NONE) body->mesh->faces[f].cut = 1;
    s = make_scene(body, NULL, 0);
    assert_int_equal(s.contacts->embedding->point_count, 16);
    for (int i = 0; i < 16; i++) sum += (double)s.contacts->area[i];
    check_near(sum, 12, 64 * CHECK_EPSILON);
    free_scene(&s);
}

/* ---- one contact by hand ---- */

/* Only the corner (1, 1, 0) of a unit cube touches a tilted plane. The matrix is exact for one element, so that
   A v+ - b = -h W^T f(v+) for any v+, with the force f written down from its definition. */
static void test_one_corner_by_hand(void **state) {
    check_random random = check_random_seeded(21);
    (void)state;
    for (int trial = 0; trial < 20; trial++) {
        scene s = make_scene(cubes(1, 1, 1, 1), NULL, 0);
        dgfem_shape_desc desc = shape_desc();
        double h = 0.01, r = sqrt(0.75), k, d, speed, slip, fn, ct, f[3], scale;
        double a[4] = {1, 0.5 / r, 0.5 / r, -0.5 / r}; /* the basis at the corner */
        double n[3] = {-0.48, -0.6, 0.64};
        double y[12];
        dgfem_vec3 after[4], v, w, vs;
        desc.plane.normal = vec3(2 * n[0], 2 * n[1], 2 * n[2]); /* need not have unit length */
        desc.plane.offset = (dgfem_real)(2 * (n[0] + n[1] + 0.02));
        desc.velocity = vs = check_random_vec3(&random, -0.1, 0.1);
        add_shape(s.body, DGFEM_SHAPE_PLANE, desc);
        for (int i = 0; i < 4; i++) {
            s.body->velocity[i] = check_random_vec3(&random, -0.5, 0.5);
            after[i] = check_random_vec3(&random, -0.5, 0.5);
        }
        s.body->displacement[0] = vec3(0, 0, 1e-3);
        assert_int_equal(assemble(&s, h), 1);
        residual(&s, after, y);
        v = dgfemi_vec3(0, 0, 0), w = v;
        for (int i = 0; i < 4; i++) {
            v = dgfemi_add_scaled(v, (dgfem_real)a[i], s.body->velocity[i]);
            w = dgfemi_add_scaled(w, (dgfem_real)a[i], after[i]);
        }
        v = dgfemi_sub(v, vs), w = dgfemi_sub(w, vs);
        k = 0.75 * 10 * 1e6 / r;
        d = 0.02 - n[2] * 1e-3;
        speed = dot(vec3(n[0], n[1], n[2]), v);
        slip = sqrt(dot(v, v) - speed * speed);
        fn = fmax(0, k * d - 0.005 * k * speed);
        ct = 0.5 * fn / fmax(slip, 1e-3);
        speed = dot(vec3(n[0], n[1], n[2]), w);
        scale = k * d;
        for (int axis = 0; axis < 3; axis++) {
            double wi = (double)(axis == 0 ? w.x : axis == 1 ? w.y : w.z);
            f[axis] = n[axis] * (k * (d - h * speed) - 0.005 * k * speed) - ct * (wi - speed * n[axis]);
        }
        for (int i = 0; i < 12; i++) check_near(y[i], -h * a[i / 3] * f[i % 3], 256 * CHECK_EPSILON * h * scale);
        free_scene(&s);
    }
}

/* A point that would pass the surface within the step is stopped exactly there: with the step's force large against its
   inertia, d - h n.v+ = 0. One that leaves, or stays away, is not touched. */
static void test_activity(void **state) {
    dgfem_vec3 point = vec3(0.5, 0.5, 0.5);
    scene s = make_scene(cubes(1, 1, 1, 1), &point, 1);
    dgfem_shape_desc desc = shape_desc();
    double h = 0.01, k = 0.1 * 10 * 1e6 / sqrt(0.75);
    const dgfem_real *block = dgfem_matrix_block(s.matrix, 0, 0);
    (void)state;
    desc.plane.offset = (dgfem_real)0.45; /* the point is 0.05 above */
    add_shape(s.body, DGFEM_SHAPE_PLANE, desc);
    s.body->velocity[0] = vec3(0, 0, -4.9);
    assert_int_equal(assemble(&s, h), 0);
    for (int i = 0; i < 144; i++) check_near(block[i], 0, 0);
    s.body->velocity[0] = vec3(3, 0, -5.1);
    assert_int_equal(assemble(&s, h), 1);
    check_near(block[2 * 12 + 2], h * h * k, 64 * CHECK_EPSILON * h * h * k); /* no damping yet, no friction */
    check_near(block[0], 0, 0);
    check_near((double)s.b[0].z / (double)block[2 * 12 + 2], -0.05 / h, 256 * CHECK_EPSILON / h);
    /* below the surface: held while it comes or rests, free when it leaves fast enough to be out at the end */
    s.body->shapes[0].desc.plane.offset = (dgfem_real)0.55;
    s.body->velocity[0] = vec3(0, 0, 5.1);
    assert_int_equal(assemble(&s, h), 0);
    s.body->velocity[0] = vec3(0, 0, 4); /* it would not get out, but the damper would pull it in */
    assert_int_equal(assemble(&s, h), 0);
    s.body->velocity[0] = vec3(0, 0, 3);
    assert_int_equal(assemble(&s, h), 1);
    s.body->velocity[0] = vec3(0, 0, 0);
    assert_int_equal(assemble(&s, h), 1);
    check_near(s.b[0].z, h * k * 0.05, 256 * CHECK_EPSILON * h * k);
    /* gravity counts: by the end of the step it will have slowed the body down */
    s.body->shapes[0].desc.damping = 0;
    s.body->velocity[0] = vec3(0, 0, 5.05);
    assert_int_equal(assemble(&s, h), 0);
    s.body->desc.gravity = vec3(0, 0, -9.81);
    assert_int_equal(assemble(&s, h), 1);
    s.body->desc.gravity = vec3(0, 0, 0);
    /* but a point just above the surface is not held there by it */
    s.body->shapes[0].desc.plane.offset = (dgfem_real)0.4999;
    s.body->velocity[0] = vec3(0, 0, 0);
    s.body->desc.gravity = vec3(0, 0, -9.81);
    assert_int_equal(assemble(&s, h), 0);
    s.body->desc.gravity = vec3(0, 0, 0);
    /* a plane that moves up reaches the point just as well as a point that moves down */
    s.body->shapes[0].desc.plane.offset = (dgfem_real)0.45;
    s.body->shapes[0].desc.velocity = vec3(0, 0, 5.1);
    assert_int_equal(assemble(&s, h), 1);
    /* a body that has gone to NaN touches nothing */
    s.body->displacement[0].z = (dgfem_real)NAN;
    assert_int_equal(assemble(&s, h), 0);
    free_scene(&s);
}

/* ---- several elements ---- */

/* P >= W^T B W for random velocities and for those that alternate from element to element; equal for translations where
   all weights have one sign. And the step is linearised exactly about the current velocity: A v - b = -h W^T f(v). */
static void test_bound_of_the_coupling(void **state) {
    check_random random = check_random_seeded(22);
    double least = 1e300, most = 0;
    (void)state;
    for (int trial = 0; trial < 24; trial++) {
        int corners = trial % 2, degree = 1 + trial % 3, sum_size;
        dgfem_vec3 points[3];
        dgfem_shape_desc desc = shape_desc();
        dgfem_body *body = cubes(3, 2, 2, degree);
        dgfem_vec3 *x = (dgfem_vec3 *)calloc((size_t)body->basis_count, sizeof *x);
        double *row = (double *)calloc((size_t)body->basis_count, sizeof *row);
        double *y = (double *)calloc((size_t)(3 * body->basis_count), sizeof *y);
        double *expected = (double *)calloc((size_t)(3 * body->basis_count), sizeof *expected);
        double h = 0.01, d = 0.3;
        scene s;
        for (int i = 0; i < 3; i++)
            points[i] = vec3(check_random_real(&random, 0, 3), check_random_real(&random, 0, 2), 0.001);
        s = make_scene(body, points, corners ? 0 : 3);
        desc.plane.offset = (dgfem_real)0.3; /* everything at the bottom, z <= 0.001, is below */
        desc.stiffness = 1;
        add_shape(body, DGFEM_SHAPE_PLANE, desc);
        for (int i = 0; i < body->basis_count; i++) body->velocity[i] = check_random_vec3(&random, -0.05, 0.05);
        sum_size = assemble(&s, h);
        assert_int_equal(sum_size, corners ? 12 : 3);
        for (int kind = 0; kind < 4; kind++) { /* A x.x against sum over the points of B (W x).(W x) */
            double quadratic = 0, exact = 0;
            for (int e = 0; e < body->mesh->element_count; e++)
                for (int i = body->basis_start[e]; i < body->basis_start[e + 1]; i++) {
                    x[i] = check_random_vec3(&random, -1, 1);
                    if (kind == 2) x[i] = vec3(0, 0, 0);
                    if (kind == 2 && i == body->basis_start[e]) x[i] = vec3(0.3, 0.4, 0.5);
                    if (kind == 3) x[i] = vec3(0, 0, e % 2 ? 1 : -1);
                }
            memset(y, 0, (size_t)(3 * body->basis_count) * sizeof *y);
            {
                dgfem_vec3 *b = s.b;
                s.b = (dgfem_vec3 *)calloc((size_t)body->basis_count, sizeof *b);
                residual(&s, x, y);
                free(s.b);
                s.b = b;
            }
            for (int i = 0; i < body->basis_count; i++)
                quadratic += y[3 * i] * (double)x[i].x + y[3 * i + 1] * (double)x[i].y + y[3 * i + 2] * (double)x[i].z;
            for (int p = 0; p < s.contacts->embedding->point_count; p++) {
                double area = (double)s.contacts->area[p], k = area * 1 * 1e6 / sqrt(0.75), fn, ct, slip, depth;
                dgfem_vec3 v, w;
                if ((double)s.contacts->embedding->points[p].z > 0.01) continue;
                depth = d - (double)s.contacts->embedding->points[p].z;
                row_of(&s, p, row);
                v = row_times(&s, row, body->velocity), w = row_times(&s, row, x);
                fn = k * depth - 0.005 * k * (double)v.z;
                slip = sqrt((double)v.x * (double)v.x + (double)v.y * (double)v.y);
                ct = 0.5 * fn / fmax(slip, 1e-3);
                exact += h * k * (h + 0.005) * (double)w.z * (double)w.z;
                exact += h * ct * ((double)w.x * (double)w.x + (double)w.y * (double)w.y);
            }
            assert_true(quadratic >= exact * (1 - 1e4 * CHECK_EPSILON));
            if (kind == 2 && corners) check_near(quadratic / exact, 1, 1e4 * CHECK_EPSILON);
            if (kind == 2 && !corners) least = fmin(least, quadratic / exact), most = fmax(most, quadratic / exact);
        }
        residual(&s, body->velocity, y);
        memset(expected, 0, (size_t)(3 * body->basis_count) * sizeof *expected);
        for (int p = 0; p < s.contacts->embedding->point_count; p++) {
            double area = (double)s.contacts->area[p], k = area * 1 * 1e6 / sqrt(0.75), fn, ct, slip, depth;
            dgfem_vec3 v;
            if ((double)s.contacts->embedding->points[p].z > 0.01) continue;
            depth = d - (double)s.contacts->embedding->points[p].z;
            row_of(&s, p, row);
            v = row_times(&s, row, body->velocity);
            fn = k * depth - 0.005 * k * (double)v.z;
            slip = sqrt((double)v.x * (double)v.x + (double)v.y * (double)v.y);
            ct = 0.5 * fn / fmax(slip, 1e-3);
            for (int i = 0; i < body->basis_count; i++) {
                expected[3 * i] += row[i] * -ct * (double)v.x;
                expected[3 * i + 1] += row[i] * -ct * (double)v.y;
                expected[3 * i + 2] += row[i] * (k * (depth - h * (double)v.z) - 0.005 * k * (double)v.z);
            }
        }
        for (int i = 0; i < 3 * body->basis_count; i++)
            check_near(y[i], -h * expected[i], 1e4 * CHECK_EPSILON * h * 1e5);
        free_scene(&s);
        free(x);
        free(row);
        free(y);
        free(expected);
    }
    print_message("translation: bound / exact is %.3f .. %.3f for embedded points\n", least, most);
    assert_true(most < 2);
}

/* ---- friction ---- */

/* Slipping, the tangential force is friction times the normal force, against the velocity; sticking, it is less. */
static void test_friction_cone(void **state) {
    dgfem_vec3 point = vec3(0.3, 0.6, 0.5);
    scene s = make_scene(cubes(1, 1, 1, 1), &point, 1);
    dgfem_shape_desc desc = shape_desc();
    double h = 0.01, k = 0.1 * 10 * 1e6 / sqrt(0.75), y[12];
    (void)state;
    desc.plane.offset = (dgfem_real)0.6;
    add_shape(s.body, DGFEM_SHAPE_PLANE, desc);
    for (int i = 0; i < 8; i++) {
        double speed = i < 4 ? 1e-4 * (i + 1) : i, angle = 0.7 * i;
        double force = 0.5 * k * 0.1 * fmin(1, speed / 1e-3);
        s.body->velocity[0] = vec3(speed * cos(angle), speed * sin(angle), 0);
        assert_int_equal(assemble(&s, h), 1);
        residual(&s, s.body->velocity, y); /* the first three rows: the force on the whole, times -h */
        check_near(y[0], h * force * cos(angle), 1e3 * CHECK_EPSILON * h * k);
        check_near(y[1], h * force * sin(angle), 1e3 * CHECK_EPSILON * h * k);
        check_near(y[2], -h * k * 0.1, 1e3 * CHECK_EPSILON * h * k);
    }
    s.body->shapes[0].desc.friction = 0;
    assert_int_equal(assemble(&s, h), 1);
    residual(&s, s.body->velocity, y);
    check_near(y[0], 0, 1e3 * CHECK_EPSILON * h * k);
    s.body->shapes[0].desc.friction = 1;
    s.body->shapes[0].desc.slip_speed = 0; /* at rest with no slip speed: nothing to divide by */
    s.body->velocity[0] = vec3(0, 0, 0);
    assert_int_equal(assemble(&s, h), 1);
    residual(&s, s.body->velocity, y);
    check_near(y[0], 0, 0);
    free_scene(&s);
}

/* ---- shapes ---- */

static void test_shapes(void **state) {
    dgfem_shape shape;
    dgfem_vec3 n;
    (void)state;
    memset(&shape, 0, sizeof shape);
    shape.desc = shape_desc();
    shape.kind = DGFEM_SHAPE_PLANE;
    shape.desc.plane.normal = vec3(0, 3, 4);
    shape.desc.plane.offset = 10;
    check_near(dgfem_shape_distance(&shape, vec3(7, 1, 3), &n), 1, 16 * CHECK_EPSILON);
    check_near3(n, vec3(0, 0.6, 0.8), 4 * CHECK_EPSILON);
    shape.kind = DGFEM_SHAPE_SPHERE;
    shape.desc.centre = vec3(1, 0, 0);
    shape.desc.radius = 2;
    check_near(dgfem_shape_distance(&shape, vec3(1, 3, 4), &n), 3, 16 * CHECK_EPSILON);
    check_near3(n, vec3(0, 0.6, 0.8), 4 * CHECK_EPSILON);
    check_near(dgfem_shape_distance(&shape, vec3(1, 0, -0.5), &n), -1.5, 16 * CHECK_EPSILON);
    check_near3(n, vec3(0, 0, -1), 4 * CHECK_EPSILON);
    shape.desc.radius = -2; /* the inside of the same sphere */
    check_near(dgfem_shape_distance(&shape, vec3(1, 3, 4), &n), -3, 16 * CHECK_EPSILON);
    check_near3(n, vec3(0, -0.6, -0.8), 4 * CHECK_EPSILON);
    check_near(dgfem_shape_distance(&shape, vec3(1, 0, -0.5), &n), 1.5, 16 * CHECK_EPSILON);
    check_near3(n, vec3(0, 0, 1), 4 * CHECK_EPSILON);
    for (int inside = 0; inside < 2; inside++) { /* at the centre: some unit normal */
        shape.desc.radius = inside ? -2 : 2;
        check_near(dgfem_shape_distance(&shape, shape.desc.centre, &n), inside ? 2 : -2, 16 * CHECK_EPSILON);
        check_near(dgfemi_norm(n), 1, 4 * CHECK_EPSILON);
    }
}

/* Two shapes at one point count as one contact point and add up. */
static void test_two_shapes(void **state) {
    dgfem_vec3 point = vec3(0.5, 0.5, 0.5);
    scene s = make_scene(cubes(1, 1, 1, 1), &point, 1);
    dgfem_shape_desc desc = shape_desc();
    double h = 0.01, k = 0.1 * 10 * 1e6 / sqrt(0.75);
    (void)state;
    desc.friction = 0;
    desc.plane.offset = (dgfem_real)0.6;
    add_shape(s.body, DGFEM_SHAPE_PLANE, desc);
    desc.centre = vec3(-0.5, 0.5, 0.5), desc.radius = (dgfem_real)1.2;
    add_shape(s.body, DGFEM_SHAPE_SPHERE, desc);
    assert_int_equal(assemble(&s, h), 1);
    check_near3(s.b[0], vec3(h * k * 0.2, 0, h * k * 0.1), 64 * CHECK_EPSILON * h * k);
    free_scene(&s);
}

/* ---- a rigid block ---- */

/* 2 x 2 x 2 cubes that move as one: the sum over the elements of the rows and columns of the constants is the system of
   the whole, (m + A) v+ = m v + h F + b. Translations are exact, so this is a block with Coulomb friction. */
static void step_block(scene *s, double mass, dgfem_vec3 gravity, double h, int *active) {
    dgfem_real a[9];
    dgfem_vec3 *u = s->body->displacement, *v = s->body->velocity;
    dgfem_vec3 rhs = dgfemi_add_scaled(dgfemi_scale((dgfem_real)mass, v[0]), (dgfem_real)(h * mass), gravity);
    dgfem_real x[3];
    s->body->desc.gravity = gravity;
    *active = assemble(s, h);
    for (int i = 0; i < 9; i++) a[i] = (dgfem_real)(i % 4 == 0 ? mass : 0);
    for (int e = 0; e < 8; e++) {
        const dgfem_real *block = dgfem_matrix_block(s->matrix, e, e);
        for (int i = 0; i < 9; i++) a[i] += block[12 * (i / 3) + i % 3];
        rhs = dgfemi_add(rhs, s->b[4 * e]);
    }
    x[0] = rhs.x, x[1] = rhs.y, x[2] = rhs.z;
    assert_true(dgfemi_cholesky_dense(a, 3));
    dgfemi_cholesky_dense_solve(a, 3, x, 1);
    for (int e = 0; e < 8; e++) {
        v[4 * e] = dgfemi_vec3(x[0], x[1], x[2]);
        u[4 * e] = dgfemi_add_scaled(u[4 * e], (dgfem_real)h, v[4 * e]);
    }
}

/* Dropped from 0.1 it comes to rest where the contact carries its weight, and stays, for steps short and long against
   the contact's own period. */
static void test_block_comes_to_rest(void **state) {
    double steps[3] = {0.002, 0.01, 1.0 / 30};
    (void)state;
    for (int trial = 0; trial < 3; trial++) {
        scene s = make_scene(cubes(2, 2, 2, 1), NULL, 0);
        double mass = 8000, h = steps[trial], k = 10 * 1e6 / sqrt(0.75) * (4 * 0.75 + 5 * 1), peak = 0, depth;
        int active = 0, count = (int)(2 / h);
        add_shape(s.body, DGFEM_SHAPE_PLANE, shape_desc());
        for (int e = 0; e < 8; e++) s.body->displacement[4 * e] = vec3(0, 0, 0.1);
        for (int i = 0; i < count; i++) {
            double v;
            step_block(&s, mass, vec3(0, 0, -9.81), h, &active);
            v = (double)s.body->velocity[0].z;
            peak = fmax(peak, v * v);
            if (i > count / 2) assert_true(v * v < 1e-6 * peak);
        }
        assert_int_equal(active, 9);
        depth = -(double)s.body->displacement[0].z;
        check_near(depth, mass * 9.81 / k, (DGFEM_REAL_IS_FLOAT ? 1e-3 : 1e-6) * depth);
        check_near(s.body->displacement[0].x, 0, 1e-6);
        free_scene(&s);
    }
}

/* On a slope below the friction angle it sticks: it creeps slower than the slip speed. Above, it accelerates at
   a = g (sin - friction cos), but for the friction's lag: it is too large by the factor v(t + h) / v(t). */
static void test_block_on_a_slope(void **state) {
    double tangents[2] = {0.3, 0.8};
    (void)state;
    for (int trial = 0; trial < 4; trial++) {
        scene s = make_scene(cubes(2, 2, 2, 1), NULL, 0);
        int steep = trial % 2, steps = trial < 2 ? 100 : 400, active = 0;
        double angle = atan(tangents[steep]), mass = 8000, h = 1.0 / steps, before, speed;
        dgfem_vec3 gravity = vec3(9.81 * sin(angle), 0, -9.81 * cos(angle)); /* the slope is turned to z = 0 */
        add_shape(s.body, DGFEM_SHAPE_PLANE, shape_desc());
        for (int i = 0; i < steps; i++) step_block(&s, mass, gravity, h, &active);
        before = (double)s.body->velocity[0].x;
        for (int i = 0; i < steps; i++) step_block(&s, mass, gravity, h, &active);
        speed = (double)s.body->velocity[0].x;
        assert_int_equal(active, 9);
        if (!steep) {
            check_near(speed, 1e-3 * 0.3 / 0.5, 1e-5);
        } else {
            double a = 9.81 * (sin(angle) - 0.5 * cos(angle)), lag = 0.5 * 9.81 * cos(angle) * a * h / before;
            check_near(speed - before, a - lag / 2, lag / 2 + 1e-4);
        }
        free_scene(&s);
    }
}

/* ---- memory ---- */

typedef struct creation {
    dgfem_body *body;
    int corners;
} creation;

static dgfem_status create_and_destroy(void *context, const dgfem_hooks *hooks) {
    creation *c = (creation *)context;
    dgfem_vec3 points[2] = {{0, 0, 0}, {0, 0, 0}};
    dgfem_real areas[2] = {1, 2};
    dgfem_points_in in = dgfem_points_in_vec3(points, 2);
    dgfem_contacts *contacts = NULL;
    dgfem_status status;
    points[0] = vec3(0.1, 0.2, 0), points[1] = vec3(1.4, 0.2, 0);
    c->body->hooks = *hooks;
    c->body->mesh->hooks = *hooks;
    status = dgfemi_contacts_create(c->body, c->corners ? NULL : &in, c->corners ? NULL : areas, &contacts);
    if (status == DGFEM_OK) {
        check_host *host = (check_host *)hooks->reallocate_user;
        long calls = host->calls;
        scene s;
        s.body = c->body, s.contacts = contacts;
        s.b = (dgfem_vec3 *)calloc((size_t)c->body->basis_count, sizeof *s.b);
        s.matrix = NULL;
        add_shape(c->body, DGFEM_SHAPE_PLANE, shape_desc());
        c->body->shapes[0].desc.plane.offset = -100; /* nothing touches: no matrix is needed */
        assert_int_equal(dgfemi_contacts_assemble(contacts, c->body, (dgfem_real)0.01, NULL, s.b), 0);
        assert_int_equal(host->calls, calls); /* assembly allocates nothing */
        free(s.b);
        dgfemi_contacts_destroy(contacts);
    } else {
        assert_null(contacts);
    }
    memset(&c->body->mesh->hooks, 0, sizeof c->body->mesh->hooks);
    return status;
}

static void test_allocation_failures(void **state) {
    (void)state;
    for (int corners = 0; corners < 2; corners++) {
        creation c;
        c.body = cubes(2, 1, 1, 1), c.corners = corners;
        print_message("%ld allocations\n", check_every_allocation(create_and_destroy, &c));
        check_body_destroy(c.body);
    }
    dgfemi_contacts_destroy(NULL);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_corner_areas),
        cmocka_unit_test(test_cut_faces_have_contact_points),
        cmocka_unit_test(test_one_corner_by_hand),
        cmocka_unit_test(test_activity),
        cmocka_unit_test(test_bound_of_the_coupling),
        cmocka_unit_test(test_friction_cone),
        cmocka_unit_test(test_shapes),
        cmocka_unit_test(test_two_shapes),
        cmocka_unit_test(test_block_comes_to_rest),
        cmocka_unit_test(test_block_on_a_slope),
        cmocka_unit_test(test_allocation_failures),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
