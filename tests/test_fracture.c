/* Fracture: glue breaks where the traction exceeds the strength, in that order, and nothing else changes. */
#include <limits.h>

#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "check_solid.h"

/* Of soft_desc's material. */
static const double mu = 1 / 2.6, lambda = 0.3 / 1.3 / 0.4;

static int count_pieces(const dgfem_body *body) {
    int count = 0;
    check_status(dgfem_body_pieces(body, NULL, NULL, 0, &count), DGFEM_OK);
    return count;
}

static int count_cut(const dgfem_body *body) {
    int count = 0;
    for (int f = 0; f < body->mesh->face_count; f++) count += body->mesh->faces[f].cut;
    return count;
}

/* The x at which all cut faces are; fails where they are not at one. */
static double crack_at(const dgfem_body *body) {
    double x = NAN;
    for (int f = 0; f < body->mesh->face_count; f++) {
        const dgfem_face *face = &body->mesh->faces[f];
        if (!face->cut) continue;
        if (isnan(x)) x = (double)face->centre.x;
        check_near(face->centre.x, x, 100 * CHECK_EPSILON);
    }
    return x;
}

static dgfem_fracture_info fracture(dgfem_body *body, const dgfem_fracture_desc *desc) {
    dgfem_fracture_info info;
    int revision = body->revision;
    check_status(dgfem_body_fracture(body, desc, &info), DGFEM_OK);
    check_status(dgfem_mesh_check(body->mesh), DGFEM_OK);
    assert_int_equal(body->revision, revision + (info.faces_broken > 0));
    return info;
}

/* A uniform strain (symmetric, of xx yy zz yz xz xy), then a turn. */
static void strain_and_turn(dgfem_body *body, const double *e, double angle) {
    double strain[9] = {1 + e[0], e[5], e[4], e[5], 1 + e[1], e[3], e[4], e[3], 1 + e[2]}, f[9];
    dgfem_mat3 turn = rotation_minus_identity(1, 2, -1, angle);
    for (int i = 0; i < 3; i++) turn.m[i][i] += 1;
    for (int i = 0; i < 9; i++) {
        f[i] = i % 4 == 0 ? -1 : 0;
        for (int k = 0; k < 3; k++) f[i] += (double)turn.m[i / 3][k] * strain[3 * k + i % 3];
    }
    check_status(dgfem_body_set_affine(body, matrix(f), vec3(1, -2, 3)), DGFEM_OK);
}

static dgfem_body *make_strained(int degree, int nx, int ny, const double *e, double angle) {
    dgfem_body_desc desc = soft_desc();
    desc.degree = degree;
    dgfem_body *body = make_box(&desc, nx, ny, 1, nx, ny, 1);
    strain_and_turn(body, e, angle);
    return body;
}

/* ---- when glue breaks ---- */

/* In a field of uniform strain the traction is known; turning the body changes nothing. */
static void test_strength(void **state) {
    (void)state;
    double e[6] = {0.01, 0, 0, 0, 0, 0}, traction = (lambda + 2 * mu) * 0.01;
    for (int degree = 1; degree <= 3; degree++)
        for (int turned = 0; turned < 2; turned++) {
            dgfem_body *body = make_strained(degree, 3, 2, e, turned ? 2.0 : 0);
            dgfem_fracture_desc desc = dgfem_default_fracture_desc();
            dgfem_fracture_info info = fracture(body, &desc);
            check_near(info.largest_ratio, 0, 0);
            desc.strength = (dgfem_real)(1.001 * traction);
            info = fracture(body, &desc);
            check_near(info.largest_ratio, 1 / 1.001, DGFEM_REAL_IS_FLOAT ? 5e-4 : 1e-12);
            assert_int_equal(info.faces_broken, 0);
            desc.strength = (dgfem_real)(0.999 * traction);
            info = fracture(body, &desc);
            assert_int_equal(info.faces_broken, 4);
            assert_int_equal(count_pieces(body), 3);
            info = fracture(body, &desc); /* what is broken is left alone */
            assert_int_equal(info.faces_broken, 0);
            dgfem_body_destroy(body);
        }
}

static void test_what_breaks_nothing(void **state) {
    (void)state;
    double strains[3][6] = {{-0.1, 0, 0, 0, 0, 0}, {0, 0, 0, 0, 0, 0.1}, {0, 0, 0.1 /* lambda pulls, too */, 0, 0, 0}};
    for (int k = 0; k < 3; k++) {
        dgfem_body *body = make_strained(1, 3, 1, strains[k], 1.0);
        dgfem_fracture_desc desc = dgfem_default_fracture_desc();
        desc.strength = DGFEM_R(0.01);
        dgfem_fracture_info info = fracture(body, &desc);
        assert_int_equal(info.faces_broken, k == 2 ? 2 : 0);
        dgfem_body_destroy(body);
    }
}

/* The stress is linear in the elements: its peak is at a face's edge. */
static void test_peak(void **state) {
    (void)state;
    dgfem_body_desc base = soft_desc();
    base.degree = 2, base.material.poisson = 0;
    dgfem_body *body = make_box(&base, 2, 1, 1, 2, 1, 1);
    double k = 0.01; /* u_x = k x (z - 1/2), u_z = - k x^2 / 2: pure bending, stress k (z - 1/2) */
    for (int e = 0; e < 2; e++) {
        dgfem_vec3 *u = body->displacement + body->basis_start[e];
        double c = (double)body->origin[e].x, s = (double)body->scale[e];
        u[0].z = (dgfem_real)(-k * c * c / 2), u[1].z = (dgfem_real)(-k * c * s), u[4].z = (dgfem_real)(-k * s * s / 2);
        u[3].x = (dgfem_real)(k * c * s), u[6].x = (dgfem_real)(k * s * s);
    }
    dgfem_fracture_desc desc = dgfem_default_fracture_desc();
    desc.strength = (dgfem_real)(k / 2);
    dgfem_fracture_info info;
    desc.max_breaks = 0;
    info = fracture(body, &desc);
    check_near(info.largest_ratio, 1, 0.01); /* each element has one rotation for its bent shape */
    assert_int_equal(info.faces_broken, 0);
    dgfem_body_destroy(body);
}

/* Between unlike elements the weaker counts; equal tractions break where the strength is exceeded most. */
static void test_two_materials(void **state) {
    (void)state;
    dgfem_body_desc base = soft_desc();
    dgfem_material materials[6];
    dgfem_real strengths[6];
    int faces[MAX_FACES];
    for (int e = 0; e < 6; e++) {
        materials[e] = base.material, materials[e].poisson = 0;
        materials[e].young = e < 3 ? 1 : 5;
        strengths[e] = e < 3 ? DGFEM_R(0.02) : DGFEM_R(0.012);
    }
    base.materials = materials;
    dgfem_body *body = make_box(&base, 6, 1, 1, 6, 1, 1);
    clamp_at_x(body, 0);
    int count = faces_at_x(body, 6, faces), id;
    check_status(dgfem_body_set_traction(body, faces, count, vec3(0.01, 0, 0), &id), DGFEM_OK);
    solve(body);
    dgfem_fracture_desc desc = dgfem_default_fracture_desc();
    desc.strengths = strengths;
    dgfem_fracture_info info = fracture(body, &desc);
    assert_int_equal(info.faces_broken, 0);
    check_near(info.largest_ratio, 0.01 / 0.012, 0.01); /* strains of a per cent */
    check_status(dgfem_body_remove_condition(body, id), DGFEM_OK);
    count = faces_at_x(body, 6, faces);
    check_status(dgfem_body_set_traction(body, faces, count, vec3(0.014, 0, 0), NULL), DGFEM_OK);
    solve(body);
    info = fracture(body, &desc); /* at the joint and in the weaker half: three faces */
    assert_int_equal(info.faces_broken, 3);
    for (int f = 0; f < body->mesh->face_count; f++)
        if (body->mesh->faces[f].cut) assert_true((double)body->mesh->faces[f].centre.x > 2.5);
    dgfem_body_destroy(body);
}

/* A bar of two rows with one broken face: there it tears, at a mean stress that elsewhere it bears. */
static void test_weakest_section(void **state) {
    (void)state;
    dgfem_body_desc base = soft_desc();
    dgfem_real strengths[16];
    int faces[MAX_FACES];
    dgfem_body *body = make_box(&base, 8, 2, 1, 8, 2, 1);
    clamp_at_x(body, 0);
    int count = faces_at_x(body, 8, faces);
    check_status(dgfem_body_set_traction(body, faces, count, vec3(0.001, 0, 0), NULL), DGFEM_OK);
    solve(body);
    for (int e = 0; e < 16; e++) strengths[e] = e == 5 ? DGFEM_R(0.0009) : 1;
    dgfem_fracture_desc desc = dgfem_default_fracture_desc();
    desc.strengths = strengths, desc.max_breaks = 1;
    dgfem_fracture_info info = fracture(body, &desc);
    assert_int_equal(info.faces_broken, 1);
    assert_int_equal(count_pieces(body), 1);
    double notch = crack_at(body);
    desc = dgfem_default_fracture_desc(), desc.strength = DGFEM_R(0.00125), desc.max_breaks = 1;
    dgfem_vec3 before, after;
    double volume = (double)dgfem_mesh_volume(body->mesh);
    check_status(dgfem_body_momentum(body, &before, NULL), DGFEM_OK);
    info = fracture(body, &desc);
    assert_int_equal(info.faces_broken, 0); /* the stress does not know of the notch yet */
    solve(body);
    info = fracture(body, &desc);
    assert_int_equal(info.faces_broken, 1);
    assert_int_equal(count_pieces(body), 2);
    check_near(crack_at(body), notch, 100 * CHECK_EPSILON);
    check_near(dgfem_mesh_volume(body->mesh), volume, 0);
    check_status(dgfem_body_momentum(body, &after, NULL), DGFEM_OK);
    check_near3(after, before, 0);
    for (int step = 0; step < 20; step++) check_status(dgfem_body_step(body, DGFEM_R(0.5), NULL), DGFEM_OK);
    dgfem_piece pieces[2];
    check_status(dgfem_body_pieces(body, NULL, pieces, 2, &count), DGFEM_OK);
    assert_true((double)pieces[1].momentum.x > 0.001 * (double)pieces[1].mass); /* the loaded end flies off */
    dgfem_body_destroy(body);
}

/* Largest first: a column that hangs by its top breaks there, once if it may only once. */
static void test_largest_first(void **state) {
    (void)state;
    dgfem_body_desc base = soft_desc();
    base.gravity = vec3(1e-3, 0, 0);
    dgfem_fracture_desc desc = dgfem_default_fracture_desc();
    desc.strength = DGFEM_R(0.0025), desc.max_breaks = 1;
    for (int round = 0; round < 2; round++) {
        dgfem_body *body = make_box(&base, 6, 1, 1, 6, 1, 1);
        clamp_at_x(body, 0);
        solve(body);
        dgfem_fracture_info info = fracture(body, &desc);
        if (round == 0) check_near(crack_at(body), 1, 100 * CHECK_EPSILON);
        assert_int_equal(info.faces_broken, round ? 3 : 1); /* 5, 4, 3 kg hang on them, 2 and 1 on the others */
        assert_int_equal(count_pieces(body), round ? 4 : 2);
        desc.max_breaks = 100;
        dgfem_body_destroy(body);
    }
}

static void test_toughness(void **state) {
    (void)state;
    double e[6] = {0.01, 0, 0, 0, 0, 0.02}, t = (lambda + 2 * mu) * 0.01, s = 2 * mu * 0.02;
    double release = 2 * (t * t / 2 + s * s / (2 * mu)); /* two unit cubes, E = 1 */
    for (int above = 0; above < 2; above++) {
        dgfem_body *body = make_strained(2, 3, 1, e, 0.5);
        dgfem_fracture_desc desc = dgfem_default_fracture_desc();
        desc.strength = (dgfem_real)(0.5 * t), desc.toughness = (dgfem_real)(above ? 1.01 * release : 0.99 * release);
        assert_int_equal(fracture(body, &desc).faces_broken, above ? 0 : 2);
        dgfem_body_destroy(body);
    }
}

/* ---- elements that break inside ---- */

/* Pulled along a diagonal, no face bears as much as the planes across it. */
static void test_split(void **state) {
    (void)state;
    double e[6] = {0.005, 0.005, 0, 0, 0, 0.005}, peak = (lambda + 2 * mu) * 0.01, on_faces = (lambda + mu) * 0.01;
    for (int degree = 1; degree <= 2; degree++) {
        dgfem_body *body = make_strained(degree, 2, 1, e, 1.5), *before = make_strained(degree, 2, 1, e, 1.5);
        dgfem_fracture_desc desc = dgfem_default_fracture_desc();
        assert_true(on_faces < 0.9 * peak);
        desc.strength = (dgfem_real)(0.95 * peak);
        assert_int_equal(fracture(body, &desc).faces_broken, 0);
        desc.split = 1, desc.smallest = DGFEM_R(0.8); /* halves of 0.5 m^3 */
        assert_int_equal(fracture(body, &desc).faces_broken, 0);
        desc.smallest = DGFEM_R(0.79), desc.max_breaks = 1;
        desc.toughness = (dgfem_real)(1.01 * peak * peak / 2 * sqrt(2.0));
        assert_int_equal(fracture(body, &desc).faces_broken, 0);
        desc.toughness = (dgfem_real)(0.99 * peak * peak / 2 * sqrt(2.0));
        dgfem_fracture_info info = fracture(body, &desc);
        assert_int_equal(info.elements_split, 1);
        assert_int_equal(info.faces_broken, 1);
        assert_int_equal(body->mesh->element_count, 3);
        for (int f = 0; f < body->mesh->face_count; f++) {
            const dgfem_face *face = &body->mesh->faces[f];
            if (!face->cut) continue;
            double along = fabs((double)face->normal.x + (double)face->normal.y) / sqrt(2.0);
            check_near(along, 1, DGFEM_REAL_IS_FLOAT ? 1e-3 : 1e-12);
        }
        for (int k = 0; k < body->mesh->element_count; k++) {
            dgfem_vec3 x = body->mesh->elements[k].centre;
            check_near3(dgfem_body_displacement(body, k, x),
                        dgfem_body_displacement(before, body->mesh->elements[k].tag, x), 50 * CHECK_EPSILON);
        }
        desc.max_breaks = INT_MAX, desc.toughness = 0;
        info = fracture(body, &desc); /* the stress is as it was: the other element breaks, too */
        assert_true(info.elements_split >= 1);
        assert_true(count_cut(body) >= 2);
        check_status(dgfem_body_step(body, DGFEM_R(0.01), NULL), DGFEM_OK);
        dgfem_body_destroy(body);
        dgfem_body_destroy(before);
    }
}

/* Where a face breaks, its elements do not. */
static void test_split_is_last(void **state) {
    (void)state;
    double e[6] = {0.01, 0, 0, 0, 0, 0};
    dgfem_body *body = make_strained(1, 2, 1, e, 0);
    dgfem_fracture_desc desc = dgfem_default_fracture_desc();
    desc.strength = DGFEM_R(0.005), desc.split = 1;
    dgfem_fracture_info info = fracture(body, &desc);
    assert_int_equal(info.faces_broken, 1);
    assert_int_equal(info.elements_split, 0);
    dgfem_body_destroy(body);
}

/* ---- with refinement ---- */

static dgfem_refine_action split_all(void *user, const dgfem_body *body, int element, dgfem_refine_action proposed) {
    (void)body, (void)element, (void)proposed;
    return *(const dgfem_refine_action *)user;
}

/* What a crack has parted stays apart when the parts of an element are merged again. */
static void test_families_with_cracks(void **state) {
    (void)state;
    double e[6] = {0.01, 0, 0, 0, 0, 0};
    dgfem_body *body = make_strained(1, 1, 1, e, 0);
    dgfem_refine_desc refine = dgfem_default_refine_desc();
    dgfem_refine_action action = DGFEM_REFINE_EIGHT;
    dgfem_fracture_desc desc = dgfem_default_fracture_desc();
    refine.choose = split_all, refine.user = &action;
    check_status(dgfem_body_refine(body, &refine, NULL), DGFEM_OK);
    assert_int_equal(body->mesh->element_count, 8);
    desc.strength = DGFEM_R(0.01); /* between lambda and lambda + 2 mu, times the strain */
    assert_int_equal(fracture(body, &desc).faces_broken, 4);
    action = DGFEM_REFINE_MERGE;
    dgfem_refine_info info;
    check_status(dgfem_body_refine(body, &refine, &info), DGFEM_OK);
    check_status(dgfem_mesh_check(body->mesh), DGFEM_OK);
    assert_int_equal(info.elements_merged, 6);
    assert_int_equal(body->mesh->element_count, 2);
    assert_int_equal(count_pieces(body), 2);
    assert_int_equal(body->family_count, 0);
    dgfem_body_destroy(body);
}

/* ---- bad input and failures ---- */

static void test_bad_input(void **state) {
    (void)state;
    check_host host;
    dgfem_body_desc base = soft_desc();
    dgfem_fracture_desc desc = dgfem_default_fracture_desc(), empty;
    dgfem_real strengths[2] = {1, (dgfem_real)NAN};
    base.hooks = check_hooks(&host);
    dgfem_body *body = make_box(&base, 2, 1, 1, 2, 1, 1);
    dgfem_body before = *body;
    memset(&empty, 0, sizeof empty);
    check_status(dgfem_body_fracture(NULL, &desc, NULL), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_body_fracture(body, NULL, NULL), DGFEM_ERROR_DESCRIPTOR), check_logged(&host, "fracture");
    check_status(dgfem_body_fracture(body, &empty, NULL), DGFEM_ERROR_DESCRIPTOR), check_logged(&host, "fracture");
    desc.strength = 0;
    check_status(dgfem_body_fracture(body, &desc, NULL), DGFEM_ERROR_ARGUMENT), check_logged(&host, "strength is 0");
    desc.strength = (dgfem_real)NAN;
    check_status(dgfem_body_fracture(body, &desc, NULL), DGFEM_ERROR_ARGUMENT), check_logged(&host, "strength");
    desc.strengths = strengths;
    check_status(dgfem_body_fracture(body, &desc, NULL), DGFEM_ERROR_ARGUMENT), check_logged(&host, "element 1");
    desc = dgfem_default_fracture_desc(), desc.toughness = -1;
    check_status(dgfem_body_fracture(body, &desc, NULL), DGFEM_ERROR_ARGUMENT), check_logged(&host, "toughness");
    desc = dgfem_default_fracture_desc(), desc.smallest = (dgfem_real)NAN;
    check_status(dgfem_body_fracture(body, &desc, NULL), DGFEM_ERROR_ARGUMENT), check_logged(&host, "smallest");
    desc = dgfem_default_fracture_desc(), desc.sliver = 1;
    check_status(dgfem_body_fracture(body, &desc, NULL), DGFEM_ERROR_ARGUMENT), check_logged(&host, "sliver");
    desc = dgfem_default_fracture_desc(), desc.max_breaks = -1;
    check_status(dgfem_body_fracture(body, &desc, NULL), DGFEM_ERROR_ARGUMENT), check_logged(&host, "max_breaks");
    assert_memory_equal(&before, body, sizeof before);
    dgfem_body_destroy(body);
    assert_int_equal(host.live, 0);
}

static void test_failures_change_nothing(void **state) {
    (void)state;
    double e[6] = {0.01, 0.009, 0, 0, 0, 0.005};
    check_host host;
    dgfem_body_desc base = soft_desc();
    base.hooks = check_hooks(&host);
    dgfem_body *body = make_box(&base, 3, 1, 1, 3, 1, 1);
    dgfem_fracture_desc desc = dgfem_default_fracture_desc();
    dgfem_fracture_info info;
    strain_and_turn(body, e, 1.0);
    desc.strength = DGFEM_R(0.015), desc.split = 1, desc.max_breaks = 2;
    dgfem_body before = *body;
    long live = host.live, fail = 1;
    for (;; fail++) {
        host.fail_from = host.calls + fail;
        dgfem_status status = dgfem_body_fracture(body, &desc, &info);
        host.fail_from = 0;
        if (!status) break;
        check_status(status, DGFEM_ERROR_MEMORY);
        check_logged(&host, "out of memory");
        assert_memory_equal(&before, body, sizeof before);
        assert_int_equal(host.live, live);
    }
    assert_true(fail > 20);
    assert_true(info.faces_broken > 0);
    dgfem_body_destroy(body);
    assert_int_equal(host.live, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_strength),
        cmocka_unit_test(test_what_breaks_nothing),
        cmocka_unit_test(test_peak),
        cmocka_unit_test(test_two_materials),
        cmocka_unit_test(test_weakest_section),
        cmocka_unit_test(test_largest_first),
        cmocka_unit_test(test_toughness),
        cmocka_unit_test(test_split),
        cmocka_unit_test(test_split_is_last),
        cmocka_unit_test(test_families_with_cracks),
        cmocka_unit_test(test_bad_input),
        cmocka_unit_test(test_failures_change_nothing),
    };
    return cmocka_run_group_tests_name("fracture", tests, NULL, NULL);
}
