/* Embedding: stitched samples, locating points, moving least squares weights. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "check.h"
#include "check_body.h"
#include "check_threads.h"

/* ---- meshes ---- */

static dgfem_mesh *grid(int nx, int ny, int nz, dgfem_vec3 lower, dgfem_vec3 upper) {
    dgfem_grid_desc desc = dgfem_default_grid_desc();
    dgfem_mesh *mesh;
    desc.cells[0] = nx, desc.cells[1] = ny, desc.cells[2] = nz;
    desc.lower = lower, desc.upper = upper;
    check_status(dgfem_mesh_create_grid(&desc, &mesh), DGFEM_OK);
    return mesh;
}

/* nx * ny * nz unit cubes */
static dgfem_mesh *cubes(int nx, int ny, int nz) { return grid(nx, ny, nz, vec3(0, 0, 0), vec3(nx, ny, nz)); }

/* n^3 unit cubes, six tetrahedra around the diagonal of each: one for each order of the axes. */
static dgfem_mesh *tetrahedra(int n) {
    static const int orders[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}};
    int side = n + 1, vertex_count = side * side * side, count = 0;
    int step[3];
    dgfem_vec3 *vertices = (dgfem_vec3 *)calloc((size_t)vertex_count, sizeof *vertices);
    int *indices = (int *)calloc((size_t)(24 * n * n * n), sizeof *indices);
    dgfem_tetrahedra_desc desc = dgfem_default_tetrahedra_desc();
    dgfem_mesh *mesh;
    step[0] = 1, step[1] = side, step[2] = side * side;
    for (int v = 0; v < vertex_count; v++) vertices[v] = vec3(v % side, v / side % side, v / side / side);
    for (int cell = 0; cell < n * n * n; cell++)
        for (int o = 0; o < 6; o++, count++) {
            int a = cell % n + side * (cell / n % n) + side * side * (cell / n / n);
            int b = a + step[orders[o][0]], c = b + step[orders[o][1]], d = c + step[orders[o][2]];
            int even = o < 3; /* an odd order of the axes mirrors the tetrahedron */
            indices[4 * count] = a, indices[4 * count + 1] = even ? b : c, indices[4 * count + 2] = even ? c : b;
            indices[4 * count + 3] = d;
        }
    desc.vertices = dgfem_points_in_vec3(vertices, vertex_count);
    desc.tetrahedra = indices, desc.tetrahedron_count = count;
    check_status(dgfem_mesh_create_tetrahedra(&desc, &mesh), DGFEM_OK);
    free(vertices);
    free(indices);
    return mesh;
}

/* Cubes cut by random planes. */
static dgfem_mesh *polyhedra(int n, int planes, check_random *random) {
    dgfem_mesh *mesh = cubes(n, n, n);
    for (int i = 0; i < planes; i++) {
        dgfem_plane plane;
        plane.normal = check_random_vec3(random, -1, 1);
        plane.offset = (dgfem_real)n / 2 * (plane.normal.x + plane.normal.y + plane.normal.z);
        plane.offset += (dgfem_real)check_random_real(random, -0.3, 0.3);
        check_status(dgfem_mesh_split_plane(mesh, plane, (dgfem_real)1e-3, NULL), DGFEM_OK);
    }
    return mesh;
}

/* A sphere of radius 1 about the origin, an octahedron refined `levels` times, cut by a grid. */
static dgfem_mesh *sliced_sphere(int levels, int cells, dgfem_vec3 **vertices, int *vertex_count) {
    int m = 1 << levels, count = 0, triangle_count = 0;
    dgfem_vec3 *points = (dgfem_vec3 *)calloc((size_t)(8 * (m + 1) * (m + 1)), sizeof *points);
    int *triangles = (int *)calloc((size_t)(24 * m * m), sizeof *triangles);
    dgfem_slice_desc desc = dgfem_default_slice_desc();
    dgfem_mesh *mesh;
    /* latitude rings of the octahedron projected to the sphere: ring r has 4 r points, for r = 0 .. m .. 0 */
    int start[2 * 64 + 2];
    for (int r = 0; r <= 2 * m; r++) {
        int ring = r <= m ? r : 2 * m - r, n = ring ? 4 * ring : 1;
        start[r] = count;
        for (int i = 0; i < n; i++) {
            double a = 2 * 3.14159265358979323846 * i / n, z = 1 - (double)r / m, s = 1 - fabs(z);
            double x = s * cos(a), y = s * sin(a), norm = sqrt(x * x + y * y + z * z);
            points[count++] = vec3(x / norm, y / norm, z / norm);
        }
    }
    start[2 * m + 1] = count;
    for (int r = 0; r < 2 * m; r++) {
        int upper = start[r], lower = start[r + 1], nu = start[r + 1] - start[r], nl = start[r + 2] - start[r + 1];
        int i = 0, j = 0;
        while (i < nu || j < nl) { /* zip the two rings, the one that lags behind goes first */
            int *t = triangles + 3 * triangle_count;
            if (nu == 1 && j == nl) break;
            if (nl == 1 && i == nu) break;
            if (nl > 1 && (nu == 1 || i == nu || (j < nl && (j + 1) * nu <= (i + 1) * nl))) {
                t[0] = upper + i % nu, t[1] = lower + j % nl, t[2] = lower + (j + 1) % nl, j++;
            } else {
                t[0] = upper + i % nu, t[1] = lower + j % nl, t[2] = upper + (i + 1) % nu, i++;
            }
            triangle_count++;
        }
    }
    desc.vertices = dgfem_points_in_vec3(points, count);
    desc.triangles = triangles, desc.triangle_count = triangle_count;
    desc.cells = cells;
    check_status(dgfem_mesh_create_slices(&desc, &mesh), DGFEM_OK);
    free(triangles);
    if (vertices) *vertices = points, *vertex_count = count;
    else free(points);
    return mesh;
}

/* Two towers of unit cubes, two wide, on a common base of `base` layers, with a slit between them. */
static dgfem_mesh *towers(int height, int base) {
    dgfem_mesh *mesh = cubes(4, 2, height);
    for (int f = 0; f < mesh->face_count; f++) {
        dgfem_face *face = &mesh->faces[f];
        if (face->element[1] == DGFEM_NONE) continue;
        if (fabs((double)face->centre.x - 2) < 0.1 && (double)face->centre.z > base) face->cut = 1;
    }
    return mesh;
}

/* ---- checks ---- */

static dgfem_embedding *embed(const dgfem_body *body, const dgfem_vec3 *points, int count) {
    dgfem_embedding *embedding;
    check_status(dgfem_embedding_create(body, dgfem_points_in_vec3(points, count), &embedding), DGFEM_OK);
    assert_int_equal(embedding->point_count, count);
    return embedding;
}

static dgfem_vec3 *evaluate(const dgfem_embedding *embedding, const dgfem_body *body, const dgfem_vec3 *coefficients) {
    dgfem_vec3 *samples = (dgfem_vec3 *)calloc((size_t)embedding->sample_count + 1, sizeof *samples);
    dgfem_vec3 *points = (dgfem_vec3 *)calloc((size_t)embedding->point_count + 1, sizeof *points);
    dgfemi_embedding_samples(embedding, body, coefficients, samples);
    dgfemi_embedding_points(embedding, samples, points);
    free(samples);
    return points;
}

/* The weights sum to one and reproduce the position, and any affine field of the body comes out at the points. */
static void check_reproduction(dgfem_body *body, const dgfem_vec3 *points, int count, double size,
                               check_random *random) {
    dgfem_embedding *embedding = embed(body, points, count);
    check_affine affine = check_random_affine(random);
    double tolerance = 64 * CHECK_EPSILON * size;
    dgfem_vec3 *u;
    for (int p = 0; p < count; p++) {
        double sum = 0, x = 0, y = 0, z = 0, magnitude = 0;
        int first = embedding->weight_start[p], last = embedding->weight_start[p + 1];
        assert_true(last > first);
        for (int i = first; i < last; i++) {
            dgfem_vec3 s = embedding->samples[embedding->weight_sample[i]];
            double w = (double)embedding->weight[i];
            if (i > first) assert_true(embedding->weight_sample[i] > embedding->weight_sample[i - 1]);
            sum += w, magnitude += fabs(w);
            x += w * (double)(s.x - points[p].x), y += w * (double)(s.y - points[p].y),
                z += w * (double)(s.z - points[p].z);
        }
        assert_true(magnitude < 64);
        check_near(sum, 1, 16 * CHECK_EPSILON * magnitude);
        check_near(x, 0, tolerance);
        check_near(y, 0, tolerance);
        check_near(z, 0, tolerance);
    }
    check_set_affine(body, body->displacement, &affine);
    u = evaluate(embedding, body, body->displacement);
    for (int p = 0; p < count; p++) check_near3(u[p], check_affine_at(&affine, points[p]), 4 * tolerance);
    free(u);
    dgfem_embedding_destroy(embedding);
}

/* Random points in the box of the mesh, all its vertices, and all face centres. */
static dgfem_vec3 *probe_points(const dgfem_mesh *mesh, int inside, check_random *random, int *count) {
    dgfem_vec3 *points = (dgfem_vec3 *)calloc((size_t)(inside + mesh->vertex_count + mesh->face_count), sizeof *points);
    dgfem_vec3 lower = mesh->vertices[0], upper = lower;
    int n = 0;
    for (int v = 0; v < mesh->vertex_count; v++) {
        lower = dgfemi_min3(lower, mesh->vertices[v]), upper = dgfemi_max3(upper, mesh->vertices[v]);
        points[n++] = mesh->vertices[v];
    }
    for (int f = 0; f < mesh->face_count; f++) points[n++] = mesh->faces[f].centre;
    for (int i = 0; i < inside; i++, n++) {
        dgfem_vec3 t = check_random_vec3(random, 0, 1), d = dgfemi_sub(upper, lower);
        points[n] = dgfemi_add(lower, dgfemi_vec3(t.x * d.x, t.y * d.y, t.z * d.z));
    }
    *count = n;
    return points;
}

static void check_mesh_reproduces(dgfem_mesh *mesh, const int *degrees, int degree, double size, check_random *random) {
    dgfem_body *body = check_body_create(mesh, degrees, degree, NULL);
    int count;
    dgfem_vec3 *points = probe_points(mesh, 100, random, &count);
    check_reproduction(body, points, count, size, random);
    free(points);
    check_body_destroy(body);
}

/* ---- linear fields ---- */

static void test_affine_fields_on_grids(void **state) {
    check_random random = check_random_seeded(1);
    int degrees[24];
    (void)state;
    for (int degree = 1; degree <= 3; degree++) check_mesh_reproduces(cubes(4, 3, 2), NULL, degree, 4, &random);
    for (int e = 0; e < 24; e++) degrees[e] = 1 + check_random_int(&random, 3);
    check_mesh_reproduces(cubes(4, 3, 2), degrees, 0, 4, &random);
    check_mesh_reproduces(grid(5, 4, 3, vec3(-1, 2, 0), vec3(9, 3, 0.5)), NULL, 1, 20, &random);
    /* far away the coordinates themselves are rounded to eps * 1000 */
    check_mesh_reproduces(grid(3, 3, 3, vec3(1000, -1000, 1000), vec3(1003, -997, 1003)), NULL, 1, 3000, &random);
    check_mesh_reproduces(grid(3, 3, 3, vec3(0, 0, 0), vec3(3e-4, 3e-4, 3e-4)), NULL, 1, 1, &random);
}

static void test_affine_fields_on_tetrahedra(void **state) {
    check_random random = check_random_seeded(2);
    (void)state;
    check_mesh_reproduces(tetrahedra(1), NULL, 1, 4, &random);
    check_mesh_reproduces(tetrahedra(3), NULL, 2, 4, &random);
}

static void test_affine_fields_on_polyhedra(void **state) {
    check_random random = check_random_seeded(3);
    (void)state;
    for (int i = 0; i < 3; i++) check_mesh_reproduces(polyhedra(2, 2 + 2 * i, &random), NULL, 1 + i, 8, &random);
}

static void test_affine_fields_on_slices(void **state) {
    check_random random = check_random_seeded(4);
    (void)state;
    for (int cells = 1; cells <= 5; cells += 2) {
        dgfem_vec3 *vertices;
        int count;
        dgfem_mesh *mesh = sliced_sphere(3, cells, &vertices, &count);
        dgfem_body *body = check_body_create(mesh, NULL, 1, NULL);
        check_reproduction(body, vertices, count, 4, &random);
        free(vertices);
        check_body_destroy(body);
        check_mesh_reproduces(sliced_sphere(2, cells, NULL, NULL), NULL, 1, 4, &random);
    }
}

static void test_one_element(void **state) {
    check_random random = check_random_seeded(5);
    dgfem_body *body = check_body_create(cubes(1, 1, 1), NULL, 1, NULL);
    dgfem_vec3 points[3];
    dgfem_embedding *embedding;
    (void)state;
    points[0] = vec3(0.5, 0.5, 0.5), points[1] = vec3(1, 1, 1), points[2] = vec3(0.2, 0.9, 0.4);
    embedding = embed(body, points, 3);
    assert_int_equal(embedding->sample_count, 9); /* its corners and its centre */
    for (int p = 0; p < 3; p++) {
        assert_int_equal(embedding->point_element[p], 0);
        assert_int_equal(embedding->weight_start[p + 1] - embedding->weight_start[p], 9);
    }
    dgfem_embedding_destroy(embedding);
    check_body_destroy(body);
    check_mesh_reproduces(cubes(1, 1, 1), NULL, 3, 2, &random);
    check_mesh_reproduces(grid(1, 1, 1, vec3(0, 0, 0), vec3(1, 10, 0.1)), NULL, 1, 20, &random);
}

/* A plate so thin that no window gives well conditioned moments. Its own thickness is all that round-off is measured by
   where the field's slope across is concerned. */
static void test_thin_plate(void **state) {
    check_random random = check_random_seeded(6);
    (void)state;
    check_mesh_reproduces(grid(6, 6, 1, vec3(0, 0, 0), vec3(1, 1, 1e-2)), NULL, 1, 4, &random);
    if (!DGFEM_REAL_IS_FLOAT)
        check_mesh_reproduces(grid(6, 6, 1, vec3(0, 0, 0), vec3(1, 1, 1e-4)), NULL, 1, 4, &random);
}

static void test_points_outside(void **state) {
    check_random random = check_random_seeded(7);
    dgfem_body *body = check_body_create(cubes(3, 3, 3), NULL, 1, NULL);
    dgfem_vec3 points[64];
    dgfem_embedding *embedding;
    int widest = 0;
    (void)state;
    for (int i = 0; i < 64; i++) points[i] = check_random_vec3(&random, -2, 5);
    check_reproduction(body, points, 64, 40, &random);
    for (int i = 0; i < 64; i++) points[i] = check_random_vec3(&random, 90, 100);
    /* far outside the fit is extended: weights grow with the distance, and so does round-off */
    embedding = embed(body, points, 64);
    {
        check_affine affine = check_random_affine(&random);
        dgfem_vec3 *u;
        check_set_affine(body, body->displacement, &affine);
        u = evaluate(embedding, body, body->displacement);
        for (int p = 0; p < 64; p++) {
            check_near3(u[p], check_affine_at(&affine, points[p]), 1e4 * CHECK_EPSILON * 100);
            assert_int_equal(embedding->point_element[p], 26);
            if (embedding->weight_start[p + 1] - embedding->weight_start[p] > widest)
                widest = embedding->weight_start[p + 1] - embedding->weight_start[p];
        }
        free(u);
    }
    assert_true(widest < 60); /* of 91 samples: the windows have not been blown up */
    dgfem_embedding_destroy(embedding);
    for (int far = 0; far < 2; far++) { /* a stray point does not change what others see */
        points[0] = vec3(1.2, 1.3, 0.9), points[1] = far ? vec3(50, 1, 1) : vec3(1, 1, 1);
        embedding = embed(body, points, 2);
        if (far) assert_int_equal(embedding->weight_start[1], widest);
        widest = embedding->weight_start[1];
        dgfem_embedding_destroy(embedding);
    }
    check_body_destroy(body);
}

/* ---- samples ---- */

/* Eq. (30) by hand: the mean over the elements of a sample of their polynomials, with monomials by pow. */
static void test_samples_are_means(void **state) {
    check_random random = check_random_seeded(8);
    int degrees[8];
    dgfem_mesh *mesh = cubes(2, 2, 2);
    dgfem_body *body;
    dgfem_embedding *embedding;
    dgfem_vec3 point = vec3(1, 1, 1), *values;
    int eights = 0;
    (void)state;
    for (int e = 0; e < 8; e++) degrees[e] = 1 + e % 3;
    body = check_body_create(mesh, degrees, 0, NULL);
    for (int i = 0; i < body->basis_count; i++) body->displacement[i] = check_random_vec3(&random, -1, 1);
    embedding = embed(body, &point, 1);
    assert_int_equal(embedding->sample_count, 8 + 27);
    values = (dgfem_vec3 *)calloc((size_t)embedding->sample_count, sizeof *values);
    dgfemi_embedding_samples(embedding, body, body->displacement, values);
    for (int s = 0; s < embedding->sample_count; s++) {
        dgfem_vec3 x = embedding->samples[s];
        double sum[3] = {0, 0, 0};
        int elements = 0;
        for (int e = 0; e < 8; e++) {
            dgfem_vec3 c = body->origin[e];
            double t[3] = {(double)(x.x - c.x) / (double)body->scale[e], (double)(x.y - c.y) / (double)body->scale[e],
                           (double)(x.z - c.z) / (double)body->scale[e]};
            if (s < 8 ? s != e
                      : fabs((double)(x.x - c.x)) + fabs((double)(x.y - c.y)) + fabs((double)(x.z - c.z)) > 1.6)
                continue;
            elements++;
            for (int i = 0; i <= degrees[e]; i++)
                for (int j = 0; i + j <= degrees[e]; j++)
                    for (int k = 0; i + j + k <= degrees[e]; k++) {
                        dgfem_vec3 u = body->displacement[body->basis_start[e] + dgfem_monomial_index(i, j, k)];
                        double n = pow(t[0], i) * pow(t[1], j) * pow(t[2], k);
                        sum[0] += n * (double)u.x, sum[1] += n * (double)u.y, sum[2] += n * (double)u.z;
                    }
        }
        if (elements == 8) eights++;
        assert_int_equal(embedding->term_start[s + 1] - embedding->term_start[s], elements);
        check_near3(values[s], vec3(sum[0] / elements, sum[1] / elements, sum[2] / elements), 64 * CHECK_EPSILON);
    }
    assert_int_equal(eights, 1);
    free(values);
    dgfem_embedding_destroy(embedding);
    check_body_destroy(body);
}

/* A sliced surface has hundreds of tiny triangles per element: the corners that become samples do not follow them. */
static void test_thinning(void **state) {
    int sample_counts[2];
    (void)state;
    for (int pass = 0; pass < 2; pass++) {
        dgfem_vec3 *vertices;
        int count, least = 1000;
        dgfem_mesh *mesh = sliced_sphere(3 + 2 * pass, 3, &vertices, &count);
        dgfem_body *body = check_body_create(mesh, NULL, 1, NULL);
        dgfem_embedding *embedding = embed(body, vertices, count);
        int *of_element = (int *)calloc((size_t)mesh->element_count, sizeof *of_element);
        dgfem_mat3 *scatter = (dgfem_mat3 *)calloc((size_t)mesh->element_count, sizeof *scatter);
        for (int s = 0; s < embedding->sample_count; s++)
            for (int t = embedding->term_start[s]; t < embedding->term_start[s + 1]; t++) {
                int e = embedding->term_element[t];
                dgfem_vec3 d = dgfemi_scale(1 / mesh->elements[e].radius,
                                            dgfemi_sub(embedding->samples[s], mesh->elements[e].centre));
                of_element[e]++;
                dgfemi_add_outer(&scatter[e], 1, d, d);
            }
        for (int e = 0; e < mesh->element_count; e++) {
            dgfem_real values[3];
            dgfem_mat3 axes;
            dgfem_eigen_symmetric(scatter[e], values, &axes);
            if (of_element[e] < least) least = of_element[e];
            assert_true((double)(values[0] / values[2]) > 1e-3); /* not coplanar */
        }
        assert_true(least >= 5);
        assert_true(mesh->vertex_count > (pass ? 2000 : 150));
        sample_counts[pass] = embedding->sample_count;
        free(of_element);
        free(scatter);
        free(vertices);
        dgfem_embedding_destroy(embedding);
        check_body_destroy(body);
    }
    print_message("samples: %d on the coarse surface, %d on the fine one\n", sample_counts[0], sample_counts[1]);
    assert_true(sample_counts[1] < 27 * 16); /* at most about as many as 27 separate cubes would have, twice */
    assert_true(sample_counts[1] < 2 * sample_counts[0]);
}

/* ---- smoothness ---- */

/* Largest jump of the second difference quotient of the embedded field along a line, and of the first. */
static void line_jumps(const dgfem_body *body, dgfem_vec3 from, dgfem_vec3 to, int n, double *jump1, double *jump2) {
    dgfem_vec3 *points = (dgfem_vec3 *)calloc((size_t)n, sizeof *points), *u;
    double h = (double)dgfemi_distance(from, to) / (n - 1), last1 = 0, last2 = 0;
    dgfem_embedding *embedding;
    for (int i = 0; i < n; i++)
        points[i] = dgfemi_add_scaled(from, (dgfem_real)i / (dgfem_real)(n - 1), dgfemi_sub(to, from));
    embedding = embed(body, points, n);
    u = evaluate(embedding, body, body->displacement);
    *jump1 = *jump2 = 0;
    for (int i = 1; i < n - 1; i++) {
        double first = (double)(u[i].x - u[i - 1].x) / h;
        double second = (double)(u[i + 1].x - 2 * u[i].x + u[i - 1].x) / (h * h);
        if (i > 1) *jump1 = fmax(*jump1, fabs(first - last1)), *jump2 = fmax(*jump2, fabs(second - last2));
        last1 = first, last2 = second;
    }
    free(u);
    free(points);
    dgfem_embedding_destroy(embedding);
}

/* Where the second derivative is continuous, its jumps between neighbouring points halve with their distance. */
static void test_twice_differentiable(void **state) {
    check_random random = check_random_seeded(9);
    (void)state;
    for (int shape = 0; shape < 3; shape++) {
        dgfem_mesh *mesh = shape == 0   ? cubes(4, 4, 4)
                           : shape == 1 ? tetrahedra(2)
                                        : grid(4, 6, 3, vec3(0, 0, 0), vec3(4, 4, 4));
        double size = shape == 1 ? 2 : 4;
        int points = DGFEM_REAL_IS_FLOAT ? 101 : 801;
        dgfem_body *body = check_body_create(mesh, NULL, 1, NULL);
        for (int i = 0; i < body->basis_count; i++) body->displacement[i] = check_random_vec3(&random, -1, 1);
        for (int line = 0; line < (check_long() ? 20 : 1); line++) {
            dgfem_vec3 from = check_random_vec3(&random, 0.1, 0.5),
                       to = check_random_vec3(&random, 0.75 * size, size - 0.1);
            double first[2], second[2];
            line_jumps(body, from, to, points, &first[0], &second[0]);
            line_jumps(body, from, to, 2 * points - 1, &first[1], &second[1]);
            assert_true(first[1] < 0.6 * first[0]);
            if (!DGFEM_REAL_IS_FLOAT)
                assert_true(second[1] < 0.6 * second[0]); /* in float, round-off / h^2 covers it */
        }
        check_body_destroy(body);
    }
}

/* ---- connection ---- */

/* Sum of |weights| that a point has on samples of which an element centre lies at x > 2 (right = 1) or x < 2. */
static double weight_on_side(const dgfem_embedding *embedding, const dgfem_body *body, int point, int right) {
    double sum = 0;
    for (int i = embedding->weight_start[point]; i < embedding->weight_start[point + 1]; i++) {
        int s = embedding->weight_sample[i], hit = 0;
        for (int t = embedding->term_start[s]; t < embedding->term_start[s + 1]; t++)
            hit |= ((double)body->origin[embedding->term_element[t]].x > 2) == right;
        if (hit) sum += fabs((double)embedding->weight[i]);
    }
    return sum;
}

/* Two ears: no weight goes from one to the other unless the base that joins them is within reach. */
static void test_towers_do_not_mix(void **state) {
    dgfem_body *body = check_body_create(towers(8, 1), NULL, 1, NULL);
    dgfem_vec3 points[80];
    dgfem_embedding *embedding;
    (void)state;
    for (int i = 0; i < 80; i++) points[i] = vec3(1.95, 0.7, 0.1 * i + 0.05);
    embedding = embed(body, points, 80);
    for (int i = 0; i < 80; i++) {
        double z = 0.1 * i + 0.05, side = weight_on_side(embedding, body, i, 1);
        assert_true((double)body->origin[embedding->point_element[i]].x < 2);
        if (z > 3) assert_true(side == 0); /* the base ends at 1, the windows at 2 */
        if (z < 1) assert_true(side > 0.1);
    }
    dgfem_embedding_destroy(embedding);
    check_body_destroy(body);
}

/* Down a slit the weights of the other side come in gradually: the field has no jump. */
static void test_no_jump_along_a_slit(void **state) {
    check_random random = check_random_seeded(10);
    dgfem_body *body = check_body_create(towers(6, 2), NULL, 1, NULL);
    (void)state;
    for (int i = 0; i < body->basis_count; i++) body->displacement[i] = check_random_vec3(&random, -1, 1);
    for (int line = 0; line < 4; line++) {
        int n = 1001;
        double x = check_random_real(&random, 1.3, 1.99), y = check_random_real(&random, 0, 2), largest = 0;
        dgfem_vec3 points[1001], *u;
        dgfem_embedding *embedding;
        for (int i = 0; i < n; i++) points[i] = vec3(x, y, 5.9 - 5.8 * i / (n - 1));
        embedding = embed(body, points, n);
        u = evaluate(embedding, body, body->displacement);
        for (int i = 1; i < n; i++) largest = fmax(largest, (double)dgfemi_distance(u[i], u[i - 1]));
        assert_true(largest < 5.8 / (n - 1) * 8); /* slopes of a random field of size 1 on unit cubes */
        free(u);
        dgfem_embedding_destroy(embedding);
    }
    check_body_destroy(body);
}

/* The samples that a point takes weight from, and how far they see it, by hand: the shortest of all ways, each as long as
   the farthest box on it, found by going on as long as any way gets shorter. */
static void check_seen(const dgfem_embedding *embedding, const dgfem_body *body, int point) {
    const dgfem_mesh *mesh = body->mesh;
    double *way = (double *)calloc((size_t)mesh->element_count, sizeof *way);
    int changed = 1, next = embedding->weight_start[point];
    dgfem_vec3 x = embedding->point_window[point];
    for (int e = 0; e < mesh->element_count; e++) way[e] = e == embedding->point_element[point] ? 0 : HUGE_VAL;
    while (changed) {
        changed = 0;
        for (int f = 0; f < 2 * mesh->face_count; f++) {
            const dgfem_face *face = &mesh->faces[f / 2];
            int from = face->element[f % 2], to = face->element[1 - f % 2];
            double length;
            if (face->cut || from == DGFEM_NONE || to == DGFEM_NONE) continue;
            length = check_distance(x, dgfemi_min3(dgfemi_max3(x, embedding->element_box[2 * to]),
                                                   embedding->element_box[2 * to + 1]));
            length = fmax(length, way[from]);
            if (length < way[to]) way[to] = length, changed = 1;
        }
    }
    for (int s = 0; s < embedding->sample_count; s++) {
        double shortest = HUGE_VAL, q;
        for (int t = embedding->term_start[s]; t < embedding->term_start[s + 1]; t++)
            shortest = fmin(shortest, way[embedding->term_element[t]]);
        q = fmax(shortest, check_distance(x, embedding->samples[s])) / (double)embedding->sample_radius[s];
        if (fabs(q - 1) < 16 * CHECK_EPSILON) { /* round-off decides */
            next += next < embedding->weight_start[point + 1] && embedding->weight_sample[next] == s;
            continue;
        }
        if (q < 1) assert_true(next < embedding->weight_start[point + 1] && embedding->weight_sample[next++] == s);
    }
    assert_int_equal(next, embedding->weight_start[point + 1]);
    free(way);
}

static void test_seen_samples(void **state) {
    check_random random = check_random_seeded(17);
    dgfem_body *bodies[2];
    (void)state;
    bodies[0] = check_body_create(towers(8, 1), NULL, 1, NULL);
    bodies[1] = check_body_create(sliced_sphere(2, 5, NULL, NULL), NULL, 1, NULL);
    for (int b = 0; b < 2; b++) {
        dgfem_vec3 points[100];
        dgfem_embedding *embedding;
        for (int i = 0; i < 100; i++) {
            points[i] = check_random_vec3(&random, b ? -0.7 : 0, b ? 0.7 : 2);
            if (b == 0) points[i].x += (dgfem_real)(i % 3), points[i].z *= 2;
        }
        embedding = embed(bodies[b], points, 100);
        for (int i = 0; i < 100; i++) check_seen(embedding, bodies[b], i);
        dgfem_embedding_destroy(embedding);
        check_body_destroy(bodies[b]);
    }
}

/* Cut right through: each half has its own samples, also at the vertices that they share. */
static void test_cut_separates(void **state) {
    check_random random = check_random_seeded(11);
    dgfem_body *body = check_body_create(towers(3, 0), NULL, 1, NULL);
    dgfem_vec3 points[200];
    dgfem_embedding *embedding;
    check_affine left = check_random_affine(&random), right = check_random_affine(&random);
    dgfem_vec3 *u;
    (void)state;
    for (int i = 0; i < 200; i++) {
        points[i] = check_random_vec3(&random, 0, 2);
        if (i & 1) points[i].x += 2;
        if (i % 10 < 2) points[i].x = (dgfem_real)(i & 1 ? 2.0001 : 1.9999);
    }
    embedding = embed(body, points, 200);
    check_set_affine(body, body->velocity, &right);
    check_set_affine(body, body->displacement, &left);
    for (int e = 0; e < body->mesh->element_count; e++)
        if ((double)body->origin[e].x > 2)
            for (int i = body->basis_start[e]; i < body->basis_start[e + 1]; i++)
                body->displacement[i] = body->velocity[i];
    u = evaluate(embedding, body, body->displacement);
    for (int i = 0; i < 200; i++) {
        assert_true(weight_on_side(embedding, body, i, !(i & 1)) == 0);
        check_near3(u[i], check_affine_at(i & 1 ? &right : &left, points[i]), 1000 * CHECK_EPSILON);
    }
    free(u);
    dgfem_embedding_destroy(embedding);
    check_body_destroy(body);
}

/* ---- locating ---- */

static void test_points_find_their_cubes(void **state) {
    check_random random = check_random_seeded(12);
    dgfem_body *body = check_body_create(cubes(5, 4, 3), NULL, 1, NULL);
    dgfem_vec3 points[300];
    dgfem_embedding *embedding;
    (void)state;
    for (int i = 0; i < 300; i++) {
        points[i] = check_random_vec3(&random, 0, 3);
        if (i < 100) points[i] = check_random_vec3(&random, -1, 6); /* some outside: the nearest cube */
        if (i >= 200) points[i].x = dgfemi_vec3((dgfem_real)check_random_int(&random, 6), 0, 0).x; /* on faces */
    }
    embedding = embed(body, points, 300);
    for (int i = 0; i < 300; i++) {
        int e = embedding->point_element[i];
        dgfem_vec3 p = points[i], c = body->origin[e], half = vec3(0.5, 0.5, 0.5);
        dgfem_vec3 in_box = dgfemi_min3(dgfemi_max3(p, vec3(0, 0, 0)), vec3(5, 4, 3));
        dgfem_vec3 in_cube = dgfemi_min3(dgfemi_max3(p, dgfemi_sub(c, half)), dgfemi_add(c, half));
        double away = check_distance(p, in_box); /* no cube is nearer; far away two may be as near as numbers tell */
        check_near(check_distance(p, in_cube), away, 4 * CHECK_EPSILON * away);
        if (i >= 200) { /* of two cubes the one with the lower index */
            int cell = (int)p.x > 0 ? (int)p.x - 1 : 0;
            assert_int_equal(e, cell + 5 * ((int)p.y + 4 * (int)p.z));
        }
    }
    dgfem_embedding_destroy(embedding);
    check_body_destroy(body);
}

/* The search by rings of buckets finds what a look at every element finds, also where boxes overlap: a sheared mesh. */
static void test_nearest_element(void **state) {
    check_random random = check_random_seeded(15);
    dgfem_mesh *mesh = tetrahedra(3);
    dgfemi_arena arena = dgfemi_arena_make(&mesh->hooks);
    dgfemi_locator locator;
    int outside = 0;
    (void)state;
    for (int v = 0; v < mesh->vertex_count; v++)
        mesh->vertices[v].x += (dgfem_real)1.7 * mesh->vertices[v].y + (dgfem_real)1.3 * mesh->vertices[v].z;
    for (int f = 0; f < mesh->face_count; f++) {
        mesh->faces[f].normal = dgfemi_mesh_unit_normal(mesh, f);
        dgfemi_mesh_measure_face(mesh, f);
    }
    assert_true(dgfemi_locator_make(&arena, mesh, &locator));
    for (int i = 0; i < 400; i++) {
        dgfem_vec3 x = check_random_vec3(&random, -1, 4);
        dgfemi_location found, best;
        x.x *= 3;
        found = dgfemi_locate(&locator, x);
        best.element = DGFEM_NONE, best.distance = 0, best.nearest = x;
        if (!(found.distance > 0)) continue;
        outside++;
        for (int e = 0; e < mesh->element_count; e++) dgfemi_locator_try(&locator, e, x, &best);
        assert_int_equal(found.element, best.element);
        check_near(found.distance, best.distance, 0);
        check_near(found.distance, dgfemi_distance(found.nearest, x), 0);
    }
    assert_true(outside > 100);
    dgfemi_arena_free(&arena);
    dgfem_mesh_destroy(mesh);
}

/* What dgfemi_element_contains says, without rays: on a face, or by the solid angles of all faces. */
static int contains_by_angles(const dgfem_mesh *mesh, int element, dgfem_vec3 x) {
    const dgfem_element *e = &mesh->elements[element];
    for (int k = e->face_start; k < e->face_start + e->face_count; k++) {
        const dgfem_face *face = &mesh->faces[mesh->element_faces[k]];
        dgfem_real height = dgfemi_dot(face->normal, dgfemi_sub(x, face->centre));
        if (dgfemi_abs(height) > DGFEM_ON_FACE * e->radius) continue;
        if (dgfemi_face_covers(mesh, face, dgfemi_add_scaled(x, -height, face->normal))) return 1;
    }
    return dgfemi_element_winds_around(mesh, element, x);
}

/* Rays tell the same as solid angles: anywhere, and level with vertices, edges and faces, which rays then meet. */
static void test_containing_elements(void **state) {
    check_random random = check_random_seeded(16);
    dgfem_mesh *meshes[4];
    (void)state;
    meshes[0] = cubes(3, 2, 2), meshes[1] = tetrahedra(2), meshes[2] = polyhedra(2, 4, &random);
    meshes[3] = sliced_sphere(1, 3, NULL, NULL);
    for (int m = 0; m < 4; m++) {
        dgfem_mesh *mesh = meshes[m];
        int inside = 0, outside = 0;
        for (int i = 0; i < 6000; i++) {
            int element = check_random_int(&random, mesh->element_count), contained;
            dgfem_vec3 lower, upper, x, v = mesh->vertices[check_random_int(&random, mesh->vertex_count)];
            dgfemi_mesh_element_box(mesh, element, &lower, &upper);
            x.x = (dgfem_real)check_random_real(&random, (double)lower.x, (double)upper.x);
            x.y = (dgfem_real)check_random_real(&random, (double)lower.y, (double)upper.y);
            x.z = (dgfem_real)check_random_real(&random, (double)lower.z, (double)upper.z);
            if (i & 1) x.y = v.y;
            if (i & 2) x.z = v.z;
            if (i & 4) x = dgfemi_add_scaled(x, DGFEM_R(0.5), dgfemi_sub(mesh->elements[element].centre, x));
            contained = dgfemi_element_contains(mesh, element, x);
            assert_int_equal(contained, contains_by_angles(mesh, element, x));
            inside += contained, outside += !contained;
        }
        assert_true(inside > 1000 && outside > 300);
    }
    for (int m = 0; m < 4; m++) dgfem_mesh_destroy(meshes[m]);
}

/* A non-convex element, an L, around a cube: points in the plane of its faces but outside of it are the hard ones. */
static void test_non_convex_element(void **state) {
    check_random random = check_random_seeded(13);
    static const double l[6][2] = {{0, 0}, {2, 0}, {2, 1}, {1, 1}, {1, 2}, {0, 2}},
                        q[4][2] = {{1, 1}, {2, 1}, {2, 2}, {1, 2}};
    dgfem_polyhedron *parts[2];
    dgfem_weld_desc weld = dgfem_default_weld_desc();
    dgfem_mesh *mesh;
    dgfem_body *body;
    dgfem_vec3 points[400];
    dgfem_embedding *embedding;
    (void)state;
    for (int part = 0; part < 2; part++) { /* prisms over the two polygons */
        int n = part ? 4 : 6, loops[64], start[16], at = 0;
        dgfem_vec3 vertices[12];
        dgfem_polyhedron_desc desc = dgfem_default_polyhedron_desc();
        for (int i = 0; i < n; i++) {
            const double *p = part ? q[i] : l[i];
            vertices[i] = vec3(p[0], p[1], 0), vertices[n + i] = vec3(p[0], p[1], 1);
        }
        for (int i = 0; i < n; i++) {
            int k = (i + 1) % n;
            start[i] = at;
            loops[at] = i, loops[at + 1] = k, loops[at + 2] = n + k, loops[at + 3] = n + i, at += 4;
        }
        start[n] = at;
        for (int i = 0; i < n; i++) loops[at++] = n - 1 - i;
        start[n + 1] = at;
        for (int i = 0; i < n; i++) loops[at++] = n + i;
        start[n + 2] = at;
        desc.vertices = vertices, desc.vertex_count = 2 * n, desc.face_count = n + 2;
        desc.loop_start = start, desc.loop_vertices = loops;
        check_status(dgfem_polyhedron_create(&desc, &parts[part]), DGFEM_OK);
    }
    check_status(dgfem_mesh_create_polyhedra((const dgfem_polyhedron *const *)parts, 2, &weld, &mesh), DGFEM_OK);
    body = check_body_create(mesh, NULL, 1, NULL);
    for (int i = 0; i < 400; i++) {
        points[i] = check_random_vec3(&random, 0, 2);
        points[i].z /= 2;
        if (i % 4 == 1) points[i].x = 1; /* in the plane of one of the L's inner faces */
        if (i % 4 == 2) points[i].z = 0;
        if (i % 4 == 3) points[i].x += 2, points[i].y = 1; /* outside, in the plane of the other one */
    }
    embedding = embed(body, points, 400);
    for (int i = 0; i < 400; i++) {
        dgfem_vec3 p = points[i];
        int in_cube = (double)p.x > 1 && (double)p.y > 1, on_both = i % 4 == 1 && (double)p.y >= 1;
        if (i % 4 == 3) continue; /* equally near to both */
        assert_int_equal(embedding->point_element[i], on_both ? 0 : in_cube);
    }
    dgfem_embedding_destroy(embedding);
    check_reproduction(body, points, 400, 8, &random);
    for (int part = 0; part < 2; part++) dgfem_polyhedron_destroy(parts[part]);
    check_body_destroy(body);
}

/* ---- evaluation ---- */

static void test_same_bits_for_any_ranges(void **state) {
    check_random random = check_random_seeded(14);
    dgfem_body *body = check_body_create(cubes(9, 9, 9), NULL, 2, NULL);
    dgfem_vec3 points[600], *one, *other;
    dgfem_embedding *embedding;
    long calls = 0;
    (void)state;
    for (int i = 0; i < 600; i++) points[i] = check_random_vec3(&random, 0, 9);
    for (int i = 0; i < body->basis_count; i++) body->displacement[i] = check_random_vec3(&random, -1, 1);
    embedding = embed(body, points, 600);
    one = evaluate(embedding, body, body->displacement);
    embedding->hooks.parallel_for = check_ragged_parallel_for;
    embedding->hooks.parallel_for_user = &calls;
    other = evaluate(embedding, body, body->displacement);
    assert_int_equal(calls, 2);
    assert_memory_equal(one, other, 600 * sizeof *one);
    free(one);
    free(other);
    dgfem_embedding_destroy(embedding);
    check_body_destroy(body);
}

/* Weights too are the same bits for any number of threads, windows that had to be enlarged included. */
static void test_same_weights_for_any_threads(void **state) {
    dgfem_vec3 *vertices;
    int count;
    dgfem_mesh *mesh = sliced_sphere(4, 7, &vertices, &count);
    dgfem_body *body = check_body_create(mesh, NULL, 1, NULL);
    dgfem_embedding *one = embed(body, vertices, count);
    check_workers workers;
    (void)state;
    memset(&workers, 0, sizeof workers);
    body->hooks.parallel_for = check_parallel_for, body->hooks.parallel_for_user = &workers;
    for (workers.count = 1; workers.count <= 4; workers.count += 3) {
        dgfem_embedding *other = embed(body, vertices, count);
        size_t weights = (size_t)one->weight_start[count];
        assert_memory_equal(one->weight_start, other->weight_start, ((size_t)count + 1) * sizeof(int));
        assert_memory_equal(one->weight_sample, other->weight_sample, weights * sizeof(int));
        assert_memory_equal(one->weight, other->weight, weights * sizeof(dgfem_real));
        dgfem_embedding_destroy(other);
    }
    assert_true(workers.loops > 4);
    dgfem_embedding_destroy(one);
    free(vertices);
    check_body_destroy(body);
}

static void test_points_of_any_layout(void **state) {
    dgfem_body *body = check_body_create(cubes(2, 2, 2), NULL, 1, NULL);
    struct {
        float other, position[3];
        int more;
    } vertices[3] = {{9, {0.25f, 0.5f, 0.75f}, 1}, {9, {1.5f, 2, 0}, 1}, {9, {1, 1, 1}, 1}};
    dgfem_points_in in;
    dgfem_embedding *embedding;
    (void)state;
    in.data = vertices[0].position, in.type = DGFEM_FLOAT32, in.stride = (int)sizeof vertices[0], in.count = 3;
    check_status(dgfem_embedding_create(body, in, &embedding), DGFEM_OK);
    for (int i = 0; i < 3; i++) {
        const float *p = vertices[i].position;
        check_near3(embedding->points[i], vec3((double)p[0], (double)p[1], (double)p[2]), 0);
    }
    dgfem_embedding_destroy(embedding);
    in.count = 0, in.data = NULL;
    check_status(dgfem_embedding_create(body, in, &embedding), DGFEM_OK);
    assert_int_equal(embedding->point_count, 0);
    dgfem_embedding_destroy(embedding);
    check_body_destroy(body);
}

/* ---- what goes wrong ---- */

static void test_bad_points(void **state) {
    check_host host;
    dgfem_hooks hooks = check_hooks(&host);
    dgfem_body *body = check_body_create(cubes(2, 1, 1), NULL, 1, &hooks);
    dgfem_embedding *embedding = (dgfem_embedding *)&host;
    double data[6] = {0, 0, 0, 1, 0, 0};
    dgfem_points_in in = dgfem_points_in_double(data, 2);
    (void)state;
    data[4] = (double)NAN;
    check_status(dgfem_embedding_create(body, in, &embedding), DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "point 1");
    assert_null(embedding);
    data[4] = (double)INFINITY;
    check_status(dgfem_embedding_create(body, in, &embedding), DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "point 1");
    data[4] = 0;
    in.count = -1;
    check_status(dgfem_embedding_create(body, in, &embedding), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "-1 points");
    in.count = 2, in.stride = 8;
    check_status(dgfem_embedding_create(body, in, &embedding), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "stride of 8");
    in.stride = 0, in.data = NULL;
    check_status(dgfem_embedding_create(body, in, &embedding), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "no data");
    in.data = data;
    check_status(dgfem_embedding_create(body, in, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "no place");
    check_status(dgfem_embedding_create(NULL, in, &embedding), DGFEM_ERROR_ARGUMENT);
    dgfem_embedding_destroy(NULL);
    assert_int_equal(host.live, 0);
    check_body_destroy(body);
}

static dgfem_status create_and_destroy(void *context, const dgfem_hooks *hooks) {
    dgfem_body *body = (dgfem_body *)context;
    dgfem_vec3 points[40];
    dgfem_embedding *embedding;
    dgfem_status status;
    for (int i = 0; i < 40; i++) points[i] = vec3(0.1 * i, 0.5, 0.02 * i);
    body->hooks = *hooks;
    body->mesh->hooks = *hooks;
    status = dgfem_embedding_create(body, dgfem_points_in_vec3(points, 40), &embedding);
    if (status == DGFEM_OK) dgfem_embedding_destroy(embedding);
    else assert_null(embedding);
    memset(&body->mesh->hooks, 0, sizeof body->mesh->hooks);
    return status;
}

static void test_allocation_failures(void **state) {
    dgfem_body *body = check_body_create(cubes(4, 2, 2), NULL, 1, NULL);
    (void)state;
    print_message("%ld allocations\n", check_every_allocation(create_and_destroy, body));
    check_body_destroy(body);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_affine_fields_on_grids),
        cmocka_unit_test(test_affine_fields_on_tetrahedra),
        cmocka_unit_test(test_affine_fields_on_polyhedra),
        cmocka_unit_test(test_affine_fields_on_slices),
        cmocka_unit_test(test_one_element),
        cmocka_unit_test(test_thin_plate),
        cmocka_unit_test(test_points_outside),
        cmocka_unit_test(test_samples_are_means),
        cmocka_unit_test(test_thinning),
        cmocka_unit_test(test_twice_differentiable),
        cmocka_unit_test(test_towers_do_not_mix),
        cmocka_unit_test(test_no_jump_along_a_slit),
        cmocka_unit_test(test_seen_samples),
        cmocka_unit_test(test_cut_separates),
        cmocka_unit_test(test_points_find_their_cubes),
        cmocka_unit_test(test_nearest_element),
        cmocka_unit_test(test_containing_elements),
        cmocka_unit_test(test_non_convex_element),
        cmocka_unit_test(test_same_bits_for_any_ranges),
        cmocka_unit_test(test_same_weights_for_any_threads),
        cmocka_unit_test(test_points_of_any_layout),
        cmocka_unit_test(test_bad_points),
        cmocka_unit_test(test_allocation_failures),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
