/* The weak form: element and face matrices against closed forms, seen through the energy and the internal force. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "check_solid.h"
#include "shapes.h"

static double lambda_of(const dgfem_material *m) {
    double e = (double)m->young, nu = (double)m->poisson;
    return e * nu / ((1 + nu) * (1 - 2 * nu));
}

static double mu_of(const dgfem_material *m) { return (double)m->young / (2 * (1 + (double)m->poisson)); }

static double elastic_energy(const dgfem_body *body) {
    dgfem_energy energy;
    check_status(dgfem_body_energy(body, &energy), DGFEM_OK);
    return (double)energy.elastic;
}

/* ---- one element ---- */

/* Eigenvalues of a symmetric matrix, ascending, by Jacobi's rotations. */
static void eigenvalues(double *a, int n, double *values) {
    double largest = 0;
    for (int i = 0; i < n * n; i++) largest = fmax(largest, fabs(a[i]));
    for (int sweep = 0, left = 1; left && sweep < 50; sweep++)
        for (int p = left = 0; p < n; p++)
            for (int q = p + 1; q < n; q++) {
                if (fabs(a[p * n + q]) <= 1e-15 * largest) continue;
                left = 1;
                double theta = (a[q * n + q] - a[p * n + p]) / (2 * a[p * n + q]);
                double t = (theta < 0 ? -1 : 1) / (fabs(theta) + sqrt(theta * theta + 1));
                double c = 1 / sqrt(t * t + 1), s = t * c;
                for (int k = 0; k < n; k++) {
                    double x = a[k * n + p], y = a[k * n + q];
                    a[k * n + p] = c * x - s * y, a[k * n + q] = s * x + c * y;
                }
                for (int k = 0; k < n; k++) {
                    double x = a[p * n + k], y = a[q * n + k];
                    a[p * n + k] = c * x - s * y, a[q * n + k] = s * x + c * y;
                }
            }
    for (int i = 0; i < n; i++) {
        values[i] = a[i * n + i];
        for (int k = i; k > 0 && values[k] < values[k - 1]; k--) {
            double swap = values[k];
            values[k] = values[k - 1], values[k - 1] = swap;
        }
    }
}

/* The stiffness of a free body without warping, column by column: the force of each unit displacement. */
static double *stiffness_matrix(dgfem_body *body) {
    size_t n = 3 * (size_t)body->basis_count;
    double *k = (double *)calloc(n * n, sizeof *k);
    dgfem_vec3 *force = (dgfem_vec3 *)calloc((size_t)body->basis_count, sizeof *force);
    dgfem_real *u = (dgfem_real *)(void *)body->displacement, *f = (dgfem_real *)(void *)force;
    for (size_t j = 0; j < n; j++) {
        memset(u, 0, n * sizeof *u);
        u[j] = 1;
        check_status(dgfem_body_internal_force(body, force), DGFEM_OK);
        for (size_t i = 0; i < n; i++) k[i * n + j] = (double)f[i];
    }
    memset(u, 0, n * sizeof *u);
    free(force);
    return k;
}

/* The unit cube of linear functions: six rigid motions, five shears and one change of volume. */
static void test_eigenvalues_of_a_cube(void **state) {
    (void)state;
    dgfem_body_desc desc = soft_desc();
    double values[12];
    desc.warp = 0;
    dgfem_body *body = make_box_at(&desc, 1, 1, 1, vec3(4, -2, 1), vec3(1, 1, 1));
    double *k = stiffness_matrix(body), square = (double)body->scale[0] * (double)body->scale[0];
    check_near(square * k[3 * 12 + 3], 1.34615384615384615, 10 * CHECK_EPSILON); /* lambda + 2 mu */
    for (int i = 0; i < 12; i++)
        for (int j = 0; j < 12; j++) check_near(k[i * 12 + j], k[j * 12 + i], 4 * CHECK_EPSILON);
    eigenvalues(k, 12, values);
    for (int i = 0; i < 6; i++) check_near(square * values[i], 0, 20 * CHECK_EPSILON);
    for (int i = 6; i < 11; i++) check_near(square * values[i], 1 / 1.3, 20 * CHECK_EPSILON);
    check_near(square * values[11], 2.5, 20 * CHECK_EPSILON);
    free(k);
    dgfem_body_destroy(body);
}

/* Free elements of any degree and shape have six motions without energy and no more; two glued ones together too. */
static void test_rigid_motions_alone_are_free(void **state) {
    (void)state;
    for (int degree = 1; degree <= 3; degree++)
        for (int cells = 1; cells <= 2; cells++) {
            dgfem_body_desc desc = soft_desc();
            desc.warp = 0;
            desc.degree = degree;
            dgfem_body *body = make_box_at(&desc, cells, 1, 1, vec3(0, 0, 0), vec3(cells, 1.5, 0.75));
            int n = 3 * body->basis_count;
            double *k = stiffness_matrix(body), *values = (double *)calloc((size_t)n, sizeof *values);
            eigenvalues(k, n, values);
            for (int i = 0; i < 6; i++) check_near(values[i] / values[n - 1], 0, 20 * CHECK_EPSILON);
            assert_true(values[6] / values[n - 1] > 1e-5);
            free(values);
            free(k);
            dgfem_body_destroy(body);
        }
}

/* int_element sigma : eps of u = x^2 e_x and of u = y^3 e_x on the unit cube about its centre, in closed form. */
static void test_energy_of_quadratic_and_cubic_fields(void **state) {
    (void)state;
    dgfem_body_desc desc = soft_desc();
    desc.warp = 0;
    desc.degree = 3;
    dgfem_body *body = make_box(&desc, 1, 1, 1, 1, 1, 1);
    double modulus = lambda_of(&desc.material) + 2 * mu_of(&desc.material), mu = mu_of(&desc.material);
    double s = (double)body->scale[0];
    body->displacement[dgfem_monomial_index(2, 0, 0)].x = (dgfem_real)(s * s);
    check_near(elastic_energy(body), modulus / 2 * 4 / 12, 20 * CHECK_EPSILON); /* (2x)^2, <x^2> = 1/12 */
    body->displacement[dgfem_monomial_index(2, 0, 0)].x = 0;
    body->displacement[dgfem_monomial_index(0, 3, 0)].x = (dgfem_real)(s * s * s);
    check_near(elastic_energy(body), mu / 2 * 9 / 80, 20 * CHECK_EPSILON); /* (3y^2)^2, <y^4> = 1/80 */
    dgfem_body_destroy(body);
}

/* The rotation is that of the mean gradient; only cubic terms have one that is not the centroid's. */
static void test_mean_gradient_of_a_cubic(void **state) {
    (void)state;
    dgfem_body_desc desc = soft_desc();
    desc.degree = 3;
    dgfem_body *body = make_box_at(&desc, 1, 1, 1, vec3(3, 1, -2), vec3(1, 2, 1));
    double s = (double)body->scale[0], a = 0.9, shear = a * 3 * 4 / 12; /* u = a y^3 e_x: 3 a <y^2>, <y^2> = h^2/12 */
    body->displacement[dgfem_monomial_index(0, 3, 0)].x = (dgfem_real)(a * s * s * s);
    double angle = atan2(-shear, 2); /* of F = [1 shear; 0 1] */
    dgfem_mat3 r = dgfem_body_rotation(body, 0);
    check_near(r.m[0][0], cos(angle), 20 * CHECK_EPSILON);
    check_near(r.m[1][0], sin(angle), 20 * CHECK_EPSILON);
    check_near(r.m[0][1], -sin(angle), 20 * CHECK_EPSILON);
    check_near(r.m[2][2], 1, 20 * CHECK_EPSILON);
    /* u = a x y^2 e_x adds to the diagonal, and turns nothing */
    body->displacement[dgfem_monomial_index(0, 3, 0)].x = 0;
    body->displacement[dgfem_monomial_index(1, 2, 0)].x = (dgfem_real)(a * s * s * s);
    check_near(dgfem_body_rotation(body, 0).m[1][0], 0, 20 * CHECK_EPSILON);
    dgfem_body_destroy(body);
}

/* ---- one face ---- */

/* Gives one element of an unwarped body at rest the displacement translation + turn x (x - centre), without strain. */
static void move_element(dgfem_body *body, int element, dgfem_vec3 translation, dgfem_vec3 turn, dgfem_vec3 centre) {
    dgfem_vec3 *u = body->displacement + body->basis_start[element], c = body->origin[element];
    double s = (double)body->scale[element], t[3] = {(double)turn.x, (double)turn.y, (double)turn.z};
    double d[3] = {(double)c.x - (double)centre.x, (double)c.y - (double)centre.y, (double)c.z - (double)centre.z};
    u[0] = vec3((double)translation.x + t[1] * d[2] - t[2] * d[1], (double)translation.y + t[2] * d[0] - t[0] * d[2],
                (double)translation.z + t[0] * d[1] - t[1] * d[0]);
    u[1] = vec3(0, s * t[2], -s * t[1]);
    u[2] = vec3(-s * t[2], 0, s * t[0]);
    u[3] = vec3(s * t[1], -s * t[0], 0);
}

/* Two boxes 1 x 1 x 1 and 2 x 1 x 1 that meet in the unit square x = 1, of the given materials. */
static dgfem_body *make_pair(const dgfem_body_desc *base, const dgfem_material *materials) {
    static shape shapes[2];
    dgfem_polyhedron *polyhedra[2];
    dgfem_weld_desc weld = dgfem_default_weld_desc();
    dgfem_body_desc desc = *base;
    dgfem_body *body = NULL;
    shape_box(&shapes[0], 0, 0, 0, 1, 1, 1);
    shape_box(&shapes[1], 1, 0, 0, 3, 1, 1);
    for (int k = 0; k < 2; k++) polyhedra[k] = shape_polyhedron(&shapes[k]);
    check_status(dgfem_mesh_create_polyhedra((const dgfem_polyhedron *const *)polyhedra, 2, &weld, &desc.mesh),
                 DGFEM_OK);
    for (int k = 0; k < 2; k++) dgfem_polyhedron_destroy(polyhedra[k]);
    desc.materials = materials;
    check_status(dgfem_body_create(&desc, &body), DGFEM_OK);
    return body;
}

/* A gap between the two: eta p^2 (A/V_a + A/V_b) (mu |u|^2 + (lambda + mu) (n.u)^2) A / 2, or lambda + 2 mu for all
   directions; lambda and mu are the larger ones of the two materials, here one of each. */
static void test_energy_of_a_gap(void **state) {
    (void)state;
    const dgfem_material materials[2] = {{1, DGFEM_R(0.45), 1}, {DGFEM_R(1.5), DGFEM_R(0.1), 1}};
    double lambda = lambda_of(&materials[0]), mu = mu_of(&materials[1]);
    assert_true(lambda > lambda_of(&materials[1]) && mu > mu_of(&materials[0]));
    for (int degree = 1; degree <= 3; degree++)
        for (int flux = 0; flux < 2; flux++)
            for (int penalty = 0; penalty < 3; penalty++) {
                dgfem_body_desc desc = soft_desc();
                desc.warp = 0;
                desc.degree = degree;
                desc.flux = (dgfem_flux)flux;
                desc.penalty = (dgfem_penalty)penalty;
                desc.eta = 3;
                dgfem_body *body = make_pair(&desc, materials);
                double eta = 3 * degree * degree * (1 + 1 / 2.0);
                double normal = penalty == DGFEM_PENALTY_SCALAR ? 0 : lambda + mu;
                double any = penalty == DGFEM_PENALTY_SCALAR ? lambda + 2 * mu : mu;
                for (int e = 0; e < 2; e++) {
                    memset(body->displacement, 0, (size_t)body->basis_count * sizeof *body->displacement);
                    move_element(body, e, vec3(0.5, -0.25, 1), vec3(0, 0, 0), vec3(0, 0, 0));
                    double expected = eta / 2 * (any * (0.25 + 0.0625 + 1) + normal * 0.25);
                    check_near(elastic_energy(body) / expected, 1, 100 * CHECK_EPSILON);
                }
                dgfem_body_destroy(body);
            }
}

/* A gap that opens by a turn about the face's centre: linear in the face, so that only degree 1 sees it as the rest of
   the jump, with eta_rest mu (|u|^2 + (n.u)^2). */
static void test_energy_of_a_hinge(void **state) {
    (void)state;
    for (int degree = 1; degree <= 3; degree++)
        for (int axis = 0; axis < 3; axis++) {
            dgfem_body_desc desc = soft_desc();
            const dgfem_material materials[2] = {desc.material, desc.material};
            double lambda = lambda_of(&desc.material), mu = mu_of(&desc.material);
            double square = axis ? 1 / 12.0 : 1 / 6.0; /* <|u|^2> for a turn by 1 about an axis in the face / about n */
            double normal = axis ? 1 / 12.0 : 0;
            desc.warp = 0;
            desc.degree = degree;
            desc.eta = 3;
            desc.eta_rest = DGFEM_R(0.75);
            dgfem_body *body = make_pair(&desc, materials);
            move_element(body, 1, vec3(0, 0, 0), vec3(axis == 0, axis == 1, axis == 2), vec3(1, 0.5, 0.5));
            double expected =
                1.5 / 2 * degree * degree *
                (degree == 1 ? 0.75 * mu * (square + normal) : 3 * (mu * square + (lambda + mu) * normal));
            check_near(elastic_energy(body) / expected, 1, 200 * CHECK_EPSILON);
            dgfem_body_destroy(body);
        }
}

/* Jumps of degree p - 1 on the face have no rest, whatever the face's shape: eta_rest makes no difference to them.
   Those of degree p have one. */
static void test_projection_keeps_degree_below(void **state) {
    (void)state;
    check_random random = check_random_seeded(17);
    for (int degree = 1; degree <= 3; degree++)
        for (int jump = 0; jump <= degree; jump++) {
            double energies[2];
            check_random copy = random;
            for (int k = 0; k < 2; k++) {
                dgfem_body_desc desc = soft_desc();
                dgfem_grid_desc grid = dgfem_default_grid_desc();
                dgfem_plane plane;
                dgfem_body *body = NULL;
                random = copy;
                plane.normal = vec3(1, 0.3, 0.2), plane.offset = DGFEM_R(0.7);
                check_status(dgfem_mesh_create_grid(&grid, &desc.mesh), DGFEM_OK);
                check_status(dgfem_mesh_split_plane(desc.mesh, plane, 0, NULL), DGFEM_OK);
                desc.flux = DGFEM_FLUX_BZ;
                desc.warp = 0;
                desc.degree = degree;
                desc.eta_rest = k ? DGFEM_R(8.0) : DGFEM_R(0.5);
                check_status(dgfem_body_create(&desc, &body), DGFEM_OK);
                assert_int_equal(body->mesh->element_count, 2);
                for (int i = 0; i < dgfem_monomial_count(jump); i++)
                    body->displacement[i] = check_random_vec3(&random, -1, 1);
                energies[k] = elastic_energy(body);
                dgfem_body_destroy(body);
            }
            if (jump < degree) check_near(energies[1] / energies[0], 1, 500 * CHECK_EPSILON);
            else assert_true(energies[1] > 1.001 * energies[0]);
        }
}

/* A box that has one neighbour behind each half of a side: the penalty counts the whole side, not the half. */
static void test_penalty_of_a_divided_side(void **state) {
    (void)state;
    static shape shapes[3];
    static const int sides[6][5] = {{0, 3, 2, 1, -1}, {4, 5, 6, 7, -1}, {0, 1, 8, 5, 4},
                                    {2, 3, 7, 6, 9},  {3, 0, 4, 7, -1}, {-1, -1, -1, -1, -1}};
    dgfem_polyhedron *polyhedra[3];
    dgfem_weld_desc weld = dgfem_default_weld_desc();
    dgfem_body_desc desc = soft_desc();
    dgfem_body *body = NULL;
    shape_begin(&shapes[0]); /* the unit cube, its side x = 1 divided at z = 1/2 */
    for (int k = 0; k < 2; k++) {
        shape_vertex(&shapes[0], 0, 0, k), shape_vertex(&shapes[0], 1, 0, k);
        shape_vertex(&shapes[0], 1, 1, k), shape_vertex(&shapes[0], 0, 1, k);
    }
    shape_vertex(&shapes[0], 1, 0, 0.5), shape_vertex(&shapes[0], 1, 1, 0.5);
    for (int f = 0; f < 5; f++) {
        shape_face(&shapes[0]);
        shape_loop(&shapes[0], sides[f], sides[f][4] < 0 ? 4 : 5);
    }
    shape_quad(&shapes[0], 1, 2, 9, 8), shape_quad(&shapes[0], 8, 9, 6, 5);
    shape_box(&shapes[1], 1, 0, 0, 2, 1, 0.5);
    shape_box(&shapes[2], 1, 0, 0.5, 2, 1, 1);
    for (int k = 0; k < 3; k++) polyhedra[k] = shape_polyhedron(&shapes[k]);
    check_status(dgfem_mesh_create_polyhedra((const dgfem_polyhedron *const *)polyhedra, 3, &weld, &desc.mesh),
                 DGFEM_OK);
    for (int k = 0; k < 3; k++) dgfem_polyhedron_destroy(polyhedra[k]);
    desc.warp = 0;
    check_status(dgfem_body_create(&desc, &body), DGFEM_OK);
    double lambda = lambda_of(&desc.material), mu = mu_of(&desc.material);
    move_element(body, 0, vec3(1, 0, 0), vec3(0, 0, 0), vec3(0, 0, 0));
    double g = 1 / 1.0 + 0.5 / 0.5; /* the cube's whole side over its volume, and the neighbour's */
    check_near(elastic_energy(body) / (4 * g * (lambda + 2 * mu) / 2), 1, 100 * CHECK_EPSILON);
    move_element(body, 0, vec3(0, 0, 0), vec3(0, 0, 0), vec3(0, 0, 0));
    move_element(body, 2, vec3(0, 1, 0), vec3(0, 0, 0), vec3(0, 0, 0));
    double between = 1 / 0.5 + 1 / 0.5; /* the two neighbours' common face */
    check_near(elastic_energy(body) / (4 * (g * 0.5 + between) * mu / 2), 1, 100 * CHECK_EPSILON);
    dgfem_body_destroy(body);
}

/* A held side: b_D = 4 and one volume; a symmetry side holds the normal component alone, with lambda + 2 mu, and the
   rest of the jump with 2 mu. */
static void test_energy_of_held_faces(void **state) {
    (void)state;
    for (int degree = 1; degree <= 2; degree++)
        for (int normal_only = 0; normal_only < 2; normal_only++) {
            dgfem_body_desc desc = soft_desc();
            double lambda = lambda_of(&desc.material), mu = mu_of(&desc.material), modulus = lambda + 2 * mu;
            int faces[MAX_FACES];
            desc.warp = 0;
            desc.degree = degree;
            desc.eta = 3;
            desc.eta_rest = DGFEM_R(0.75);
            dgfem_body *body = make_box(&desc, 1, 1, 1, 2, 1, 1);
            int count = faces_at_x(body, 2, faces);
            if (normal_only) check_status(dgfem_body_fix_normal(body, faces, count, NULL), DGFEM_OK);
            else check_status(dgfem_body_fix_faces(body, faces, count, vec3(0, 0, 0), NULL), DGFEM_OK);
            double eta = 4 * (1 / 2.0) * degree * degree;
            move_element(body, 0, vec3(0.5, 0.25, -1), vec3(0, 0, 0), vec3(0, 0, 0));
            double expected = 3 * eta / 2 * (modulus * 0.25 + (normal_only ? 0 : mu * (0.0625 + 1)));
            check_near(elastic_energy(body) / expected, 1, 100 * CHECK_EPSILON);
            move_element(body, 0, vec3(0, 0, 0), vec3(0, 0, 1), vec3(2, 0.5, 0.5)); /* <(n.u)^2> = <|u|^2> = 1/12 */
            expected = eta / 2 / 12 * (degree == 1 ? 0.75 * 2 * mu : 3 * modulus);
            check_near(elastic_energy(body) / expected, 1, 200 * CHECK_EPSILON);
            move_element(body, 0, vec3(0, 0, 0), vec3(1, 0, 0), vec3(2, 0.5, 0.5)); /* <|u|^2> = 1/6, in the face */
            expected = normal_only ? 0 : eta / 2 / 6 * (degree == 1 ? 0.75 * mu : 3 * mu);
            check_near(elastic_energy(body), expected, 200 * CHECK_EPSILON);
            dgfem_body_destroy(body);
        }
}

/* A symmetry side of a turned body still holds the direction that it had at rest. */
static void test_symmetry_side_does_not_turn(void **state) {
    (void)state;
    dgfem_body_desc desc = soft_desc();
    int faces[MAX_FACES];
    dgfem_body *body = make_box(&desc, 1, 1, 1, 1, 1, 1);
    int count = faces_at_x(body, 0, faces);
    check_status(dgfem_body_fix_normal(body, faces, count, NULL), DGFEM_OK);
    /* a half turn about the x axis, and a shift in the face's plane: all points of the side stay in it */
    check_status(dgfem_body_set_affine(body, rotation_minus_identity(1, 0, 0, 3.14159265358979324), vec3(0, 7, -3)),
                 DGFEM_OK);
    check_near(elastic_energy(body), 0, 100 * CHECK_EPSILON);
    /* a turn about the z axis moves the side by - y sin(angle) along x: mean sin^2/4, rest sin^2/12; the shift along y
       makes a difference only to a direction that turns */
    check_status(dgfem_body_set_affine(body, rotation_minus_identity(0, 0, 1, 0.5), vec3(0, 2, 0)), DGFEM_OK);
    double mu = mu_of(&desc.material), modulus = lambda_of(&desc.material) + 2 * mu, square = sin(0.5) * sin(0.5);
    check_near(elastic_energy(body) / (4.0 / 2 * square * (4 * modulus / 4 + 0.5 * 2 * mu / 12)), 1,
               100 * CHECK_EPSILON);
    dgfem_body_destroy(body);
}

/* ---- patch test on other than boxes ---- */

typedef struct polynomial {
    int degree;
    dgfem_vec3 c[20];
} polynomial;

static void polynomial_at(void *user, dgfem_vec3 x, dgfem_vec3 *u) {
    const polynomial *p = (const polynomial *)user;
    double sum[3] = {0, 0, 0}, px[4] = {1}, py[4] = {1}, pz[4] = {1};
    for (int k = 1; k < 4; k++)
        px[k] = px[k - 1] * (double)x.x, py[k] = py[k - 1] * (double)x.y, pz[k] = pz[k - 1] * (double)x.z;
    for (int i = 0; i <= p->degree; i++)
        for (int j = 0; i + j <= p->degree; j++)
            for (int k = 0; i + j + k <= p->degree; k++) {
                dgfem_vec3 c = p->c[dgfem_monomial_index(i, j, k)];
                double n = px[i] * py[j] * pz[k];
                sum[0] += n * (double)c.x, sum[1] += n * (double)c.y, sum[2] += n * (double)c.z;
            }
    *u = vec3(sum[0], sum[1], sum[2]);
}

/* Largest error, half way between the centres of elements and of their faces, of the static solution with the field
   prescribed on the whole boundary. Takes the mesh over. */
static double patch_error(dgfem_mesh *mesh, int degree, polynomial *field) {
    dgfem_body_desc desc = soft_desc();
    dgfem_body *body = NULL;
    static int faces[MAX_FACES];
    double largest = 0;
    desc.warp = 0;
    desc.degree = degree;
    desc.mesh = mesh;
    check_status(dgfem_body_create(&desc, &body), DGFEM_OK);
    int count = all_boundary_faces(body, faces);
    check_status(dgfem_body_fix_faces_fn(body, faces, count, polynomial_at, field, NULL), DGFEM_OK);
    solve(body);
    for (int e = 0; e < mesh->element_count; e++)
        for (int k = 0; k < mesh->elements[e].face_count; k++) {
            dgfem_vec3 c = mesh->elements[e].centre, u;
            dgfem_vec3 f = mesh->faces[mesh->element_faces[mesh->elements[e].face_start + k]].centre;
            dgfem_vec3 x = vec3((double)(c.x + f.x) / 2, (double)(c.y + f.y) / 2, (double)(c.z + f.z) / 2);
            polynomial_at(field, x, &u);
            double error = check_distance(dgfem_body_displacement(body, e, x), u);
            if (!(error <= largest)) largest = error;
        }
    dgfem_body_destroy(body);
    return largest;
}

static dgfem_mesh *cut_cube(check_random *random) {
    dgfem_grid_desc grid = dgfem_default_grid_desc();
    dgfem_mesh *mesh = NULL;
    grid.cells[0] = 2;
    check_status(dgfem_mesh_create_grid(&grid, &mesh), DGFEM_OK);
    for (int k = 0; k < 3; k++) {
        dgfem_plane plane;
        plane.normal = check_random_vec3(random, -1, 1);
        plane.offset = (plane.normal.x + plane.normal.y + plane.normal.z) / 2;
        check_status(dgfem_mesh_split_plane(mesh, plane, DGFEM_R(0.05), NULL), DGFEM_OK);
    }
    return mesh;
}

static dgfem_mesh *sliced_octahedron(void) {
    static const double vertices[18] = {1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1};
    static const int triangles[24] = {0, 2, 4, 2, 1, 4, 1, 3, 4, 3, 0, 4, 2, 0, 5, 1, 2, 5, 3, 1, 5, 0, 3, 5};
    dgfem_slice_desc desc = dgfem_default_slice_desc();
    dgfem_mesh *mesh = NULL;
    desc.vertices = dgfem_points_in_double(vertices, 6);
    desc.triangles = triangles;
    desc.triangle_count = 8;
    desc.cells = 3;
    desc.sliver = DGFEM_R(0.05);
    check_status(dgfem_mesh_create_slices(&desc, &mesh), DGFEM_OK);
    return mesh;
}

/* Any linear field is reproduced on any polyhedra, with every degree. */
static void test_patch_on_polyhedra(void **state) {
    (void)state;
    check_random random = check_random_seeded(23);
    polynomial field;
    memset(&field, 0, sizeof field);
    field.degree = 1;
    for (int i = 0; i < 4; i++) field.c[i] = check_random_vec3(&random, -1, 1);
    for (int degree = 1; degree <= (DGFEM_REAL_IS_FLOAT ? 2 : 3); degree++) {
        double cut = patch_error(cut_cube(&random), degree, &field),
               sliced = patch_error(sliced_octahedron(), degree, &field);
        print_message("degree %d: error %.2g on a cut cube, %.2g on slices\n", degree, cut, sliced);
        check_near(cut, 0, 5000 * CHECK_EPSILON);
        check_near(sliced, 0, 5000 * CHECK_EPSILON);
    }
}

/* ---- memory of the integrals ---- */

/* Fixing and freeing again and again uses the same memory, and a fixture that fails leaves nothing. */
static void test_removed_conditions_leave_nothing(void **state) {
    (void)state;
    check_host host;
    dgfem_body_desc desc = soft_desc();
    int faces[MAX_FACES], elements[2] = {0, 1}, id;
    desc.hooks = check_hooks(&host);
    dgfem_body *body = make_box(&desc, 2, 2, 2, 1, 1, 1);
    int count = faces_of_side(body, 0, faces);
    long live = 0, calls = 0;
    for (int round = 0; round < 50; round++) {
        long before = host.calls;
        check_status(dgfem_body_fix_faces(body, faces, count, vec3(0, 0, 0), &id), DGFEM_OK);
        check_status(dgfem_body_remove_condition(body, id), DGFEM_OK);
        check_status(dgfem_body_fix_elements(body, elements, 2, &id), DGFEM_OK);
        check_status(dgfem_body_remove_condition(body, id), DGFEM_OK);
        if (round == 1) live = host.live, calls = host.calls - before;
        if (round > 1) assert_int_equal(host.calls - before, calls); /* no array has to grow again */
    }
    assert_int_equal(host.live, live);
    assert_int_equal(body->condition_count, 0);
    dgfem_body_destroy(body);
    assert_int_equal(host.live, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_eigenvalues_of_a_cube),
        cmocka_unit_test(test_rigid_motions_alone_are_free),
        cmocka_unit_test(test_energy_of_quadratic_and_cubic_fields),
        cmocka_unit_test(test_mean_gradient_of_a_cubic),
        cmocka_unit_test(test_energy_of_a_gap),
        cmocka_unit_test(test_energy_of_a_hinge),
        cmocka_unit_test(test_projection_keeps_degree_below),
        cmocka_unit_test(test_penalty_of_a_divided_side),
        cmocka_unit_test(test_energy_of_held_faces),
        cmocka_unit_test(test_symmetry_side_does_not_turn),
        cmocka_unit_test(test_patch_on_polyhedra),
        cmocka_unit_test(test_removed_conditions_leave_nothing),
    };
    return cmocka_run_group_tests_name("forms", tests, NULL, NULL);
}
