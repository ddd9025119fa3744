/* Refinement and coarsening of a living body: what is split keeps its field, what is merged its momentum, and all else
   stays where it was. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "check_solid.h"

enum { MAX_ELEMENTS = 4096 };

/* ---- bodies and fields ---- */

/* Two rows of boxes of unequal size, held at x = 0, loaded in every way that there is. */
static dgfem_body *make_loaded(int degree, const dgfem_hooks *hooks, int *pin) {
    dgfem_body_desc desc = soft_desc();
    int faces[MAX_FACES], held = 5, loaded[2] = {1, 2};
    desc.degree = degree;
    if (hooks) desc.hooks = *hooks;
    dgfem_body *body = make_box(&desc, 3, 2, 1, 3, 1, 1);
    clamp_at_x(body, 0);
    int count = faces_of_side(body, 5, faces);
    check_status(dgfem_body_set_traction(body, faces, count, vec3(1e-3, 2e-3, 0), NULL), DGFEM_OK);
    count = faces_of_side(body, 4, faces);
    check_status(dgfem_body_set_pressure(body, faces, count, DGFEM_R(1e-3), NULL), DGFEM_OK);
    check_status(dgfem_body_set_body_force(body, loaded, 2, vec3(0, 0, 1e-3), NULL), DGFEM_OK);
    check_status(dgfem_body_fix_elements(body, &held, 1, NULL), DGFEM_OK);
    check_status(dgfem_body_add_force(body, 1, vec3(1.25, 0.125, 0.75), vec3(1e-3, 0, 0), NULL), DGFEM_OK);
    check_status(dgfem_body_pin(body, 2, vec3(2.75, 0.25, 0.25), DGFEM_R(0.5), pin), DGFEM_OK);
    return body;
}

/* Held elements never merge. */
static void release_elements(dgfem_body *body) {
    for (int c = body->condition_count - 1; c >= 0; c--)
        if (body->conditions[c].kind == DGFEM_CONDITION_FIX_ELEMENTS)
            check_status(dgfem_body_remove_condition(body, body->conditions[c].id), DGFEM_OK);
}

static void randomize(dgfem_body *body, check_random *random) {
    for (int i = 0; i < body->basis_count; i++) {
        body->displacement[i] = check_random_vec3(random, -0.05, 0.05);
        body->velocity[i] = check_random_vec3(random, -1, 1);
    }
}

/* field(x) = v + w (a.x) + z (b.x)^2, of which an element of degree 2 or more can represent all. */
static dgfem_vec3 parabola(dgfem_vec3 x) {
    double s = 0.3 * (double)x.x - 0.2 * (double)x.y + 0.1 * (double)x.z;
    double t = 0.1 * (double)x.x + 0.2 * (double)x.y - 0.3 * (double)x.z;
    return vec3(0.1 + 0.2 * s + 0.3 * t * t, -0.2 + 0.1 * s - 0.2 * t * t, 0.05 - 0.3 * s + 0.1 * t * t);
}

/* Its coefficients, from values at points: a + b s + c s^2 along each axis and each diagonal of two axes is exact. */
static void set_parabola(dgfem_body *body, dgfem_vec3 *out) {
    for (int e = 0; e < body->mesh->element_count; e++) {
        dgfem_vec3 o = body->origin[e], *u = out + body->basis_start[e];
        double h = (double)body->scale[e];
        memset(u, 0, (size_t)(body->basis_start[e + 1] - body->basis_start[e]) * sizeof *u);
        u[0] = parabola(o);
        for (int i = 0; i < 3; i++) {
            double d[3] = {0, 0, 0};
            d[i] = h;
            dgfem_vec3 p = parabola(vec3((double)o.x + d[0], (double)o.y + d[1], (double)o.z + d[2]));
            dgfem_vec3 m = parabola(vec3((double)o.x - d[0], (double)o.y - d[1], (double)o.z - d[2]));
            int square = i == 0 ? 4 : i == 1 ? 7 : 9;
            u[1 + i] =
                vec3(((double)p.x - (double)m.x) / 2, ((double)p.y - (double)m.y) / 2, ((double)p.z - (double)m.z) / 2);
            u[square] =
                vec3(((double)p.x + (double)m.x) / 2 - (double)u[0].x, ((double)p.y + (double)m.y) / 2 - (double)u[0].y,
                     ((double)p.z + (double)m.z) / 2 - (double)u[0].z);
        }
        for (int i = 0; i < 3; i++)
            for (int k = i + 1; k < 3; k++) {
                double d[3] = {0, 0, 0};
                d[i] = d[k] = h;
                dgfem_vec3 p = parabola(vec3((double)o.x + d[0], (double)o.y + d[1], (double)o.z + d[2]));
                int a = i == 0 ? 4 : 7, b = k == 1 ? 7 : 9, mixed = i == 0 ? (k == 1 ? 5 : 6) : 8;
                const dgfem_vec3 *s[5] = {&u[0], &u[1 + i], &u[1 + k], &u[a], &u[b]};
                for (int q = 0; q < 5; q++) p.x -= s[q]->x, p.y -= s[q]->y, p.z -= s[q]->z;
                u[mixed] = p;
            }
    }
}

/* A point of the element: some way from its centre to a vertex. */
static dgfem_vec3 random_point(const dgfem_mesh *mesh, int e, check_random *random) {
    const dgfem_element *element = &mesh->elements[e];
    const dgfem_face *face =
        &mesh->faces[mesh->element_faces[element->face_start + check_random_int(random, element->face_count)]];
    const dgfem_loop *loop = &mesh->loops[face->loop_start];
    dgfem_vec3 p = mesh->vertices[mesh->loop_vertices[loop->start + check_random_int(random, loop->count)]];
    double t = check_random_real(random, 0, 1);
    return vec3((1 - t) * (double)element->centre.x + t * (double)p.x,
                (1 - t) * (double)element->centre.y + t * (double)p.y,
                (1 - t) * (double)element->centre.z + t * (double)p.z);
}

/* Elements keep the tag of the element that they come from: its polynomial in `before` is theirs. */
static void check_same_field(const dgfem_body *body, const dgfem_body *before, check_random *random, double tolerance) {
    for (int e = 0; e < body->mesh->element_count; e++)
        for (int i = 0; i < 3; i++) {
            dgfem_vec3 x = random_point(body->mesh, e, random);
            int tag = body->mesh->elements[e].tag;
            check_near3(dgfem_body_displacement(body, e, x), dgfem_body_displacement(before, tag, x), tolerance);
            check_near3(dgfem_body_velocity(body, e, x), dgfem_body_velocity(before, tag, x), 20 * tolerance);
        }
}

static void check_parabola(const dgfem_body *body, check_random *random, double tolerance) {
    for (int e = 0; e < body->mesh->element_count; e++) {
        dgfem_vec3 x = random_point(body->mesh, e, random);
        check_near3(dgfem_body_displacement(body, e, x), parabola(x), tolerance);
        check_near3(dgfem_body_velocity(body, e, x), parabola(x), tolerance);
    }
}

typedef struct totals {
    double volume, mass;
    dgfem_vec3 linear, angular;
} totals;

static totals sum_up(const dgfem_body *body) {
    totals t;
    t.volume = (double)dgfem_mesh_volume(body->mesh), t.mass = (double)dgfem_body_mass(body);
    check_status(dgfem_body_momentum(body, &t.linear, &t.angular), DGFEM_OK);
    return t;
}

static void check_totals(const dgfem_body *body, const totals *t, int with_angular, double tolerance) {
    totals now = sum_up(body);
    check_near(now.volume, t->volume, tolerance);
    check_near(now.mass, t->mass, tolerance);
    check_near3(now.linear, t->linear, tolerance);
    if (with_angular) check_near3(now.angular, t->angular, 4 * tolerance);
}

/* ---- deciding by hand ---- */

typedef struct plan {
    const dgfem_refine_action *actions; /* [elements], or NULL: `all` for each */
    dgfem_refine_action all;
    check_random *random; /* or one of several at random */
} plan;

static dgfem_refine_action follow_plan(void *user, const dgfem_body *body, int element, dgfem_refine_action proposed) {
    const plan *p = (const plan *)user;
    (void)body;
    assert_int_equal(proposed, DGFEM_REFINE_NONE); /* the default descriptor proposes nothing */
    if (p->random) {
        static const dgfem_refine_action some[] = {DGFEM_REFINE_NONE, DGFEM_REFINE_EIGHT, DGFEM_REFINE_NONE,
                                                   DGFEM_REFINE_TWO, DGFEM_REFINE_RAISE};
        return some[check_random_int(p->random, 5)];
    }
    return p->actions ? p->actions[element] : p->all;
}

static dgfem_refine_info carry_out(dgfem_body *body, plan *p) {
    dgfem_refine_desc desc = dgfem_default_refine_desc();
    dgfem_refine_info info;
    desc.choose = follow_plan;
    desc.user = p;
    check_status(dgfem_body_refine(body, &desc, &info), DGFEM_OK);
    check_status(dgfem_mesh_check(body->mesh), DGFEM_OK);
    return info;
}

static dgfem_refine_info refine_all(dgfem_body *body, dgfem_refine_action action) {
    plan p;
    memset(&p, 0, sizeof p);
    p.all = action;
    return carry_out(body, &p);
}

static dgfem_refine_info refine_one(dgfem_body *body, int element, dgfem_refine_action action) {
    static dgfem_refine_action actions[MAX_ELEMENTS];
    plan p;
    memset(&p, 0, sizeof p);
    memset(actions, 0, sizeof actions);
    actions[element] = action;
    p.actions = actions;
    return carry_out(body, &p);
}

/* ---- splitting ---- */

static void test_eight_boxes(void **state) {
    (void)state;
    dgfem_body_desc desc = soft_desc();
    dgfem_body *body = make_box(&desc, 2, 1, 1, 3, 1, 2);
    dgfem_refine_info info = refine_one(body, 1, DGFEM_REFINE_EIGHT);
    assert_int_equal(info.elements_split, 1);
    assert_int_equal(body->mesh->element_count, 9);
    assert_int_equal(body->revision, 1);
    for (int e = 0; e < 9; e++) {
        int whole = body->mesh->elements[e].tag == 0;
        check_near(body->mesh->elements[e].volume, whole ? 3 : 0.375, 10 * CHECK_EPSILON);
        assert_int_equal(body->family[e], whole ? DGFEM_NONE : 0);
    }
    info = refine_one(body, 0, DGFEM_REFINE_EIGHT); /* one side of it is in four parts by now */
    assert_int_equal(body->mesh->element_count, 16);
    int interior = 0;
    for (int f = 0; f < body->mesh->face_count; f++) interior += body->mesh->faces[f].element[1] != DGFEM_NONE;
    assert_int_equal(interior, 12 + 12 + 4);
    info = refine_all(body, DGFEM_REFINE_NONE);
    assert_int_equal(info.elements_split + info.elements_merged, 0);
    assert_int_equal(body->revision, 2);
    dgfem_body_destroy(body);
}

static dgfem_body *make_split(dgfem_vec3 normal, double offset) {
    dgfem_grid_desc grid = dgfem_default_grid_desc();
    dgfem_body_desc desc = soft_desc();
    dgfem_body *body = NULL;
    dgfem_plane plane;
    plane.normal = normal, plane.offset = (dgfem_real)offset;
    check_status(dgfem_mesh_create_grid(&grid, &desc.mesh), DGFEM_OK);
    check_status(dgfem_mesh_split_plane(desc.mesh, plane, 0, NULL), DGFEM_OK);
    check_status(dgfem_body_create(&desc, &body), DGFEM_OK);
    return body;
}

/* Hexahedra with oblique sides give eight parts; other shapes two. */
static void test_other_shapes(void **state) {
    (void)state;
    dgfem_body *body = make_split(vec3(1, 0.3, 0.2), 0.7); /* two frusta */
    assert_int_equal(body->mesh->element_count, 2);
    refine_all(body, DGFEM_REFINE_EIGHT);
    assert_int_equal(body->mesh->element_count, 16);
    refine_all(body, DGFEM_REFINE_EIGHT);
    assert_int_equal(body->mesh->element_count, 128);
    dgfem_body_destroy(body);
    body = make_split(vec3(1, 1, 1), 0.5); /* a corner off: a tetrahedron and a heptahedron */
    refine_all(body, DGFEM_REFINE_EIGHT);
    assert_int_equal(body->mesh->element_count, 4);
    dgfem_body_destroy(body);
    body = make_split(vec3(1, 1, 0), 0.5); /* a prism, and one of five sides */
    refine_all(body, DGFEM_REFINE_EIGHT);
    assert_int_equal(body->mesh->element_count, 4);
    dgfem_body_destroy(body);
}

/* Rounds of random splits and raises leave a random field as it was, and all that hangs on the body. */
static void test_splits_are_exact(void **state) {
    (void)state;
    for (int degree = 1; degree <= 3; degree++) {
        check_random random = check_random_seeded((uint64_t)(20 + degree)), same = check_random_seeded(5);
        dgfem_body *body = make_loaded(degree, NULL, NULL), *before = make_loaded(degree, NULL, NULL);
        plan p;
        randomize(body, &same);
        memcpy(before->displacement, body->displacement, (size_t)body->basis_count * sizeof *body->displacement);
        memcpy(before->velocity, body->velocity, (size_t)body->basis_count * sizeof *body->velocity);
        totals t = sum_up(body);
        memset(&p, 0, sizeof p);
        p.random = &random;
        for (int round = 0; round < 3; round++) {
            dgfem_refine_info info = carry_out(body, &p);
            assert_true(info.elements_split > 0);
            check_totals(body, &t, 1, 500 * CHECK_EPSILON);
            check_same_field(body, before, &random, 100 * CHECK_EPSILON);
        }
        assert_in_range(body->mesh->element_count, 40, 3000);
        dgfem_body_destroy(body);
        dgfem_body_destroy(before);
    }
}

static double area_of(const dgfem_body *body, const dgfem_condition *condition) {
    double area = 0;
    for (int i = 0; i < condition->count; i++) area += (double)body->mesh->faces[condition->items[i]].area;
    return area;
}

static void test_conditions_survive(void **state) {
    (void)state;
    int pin;
    dgfem_body *body = make_loaded(1, NULL, &pin);
    dgfem_vec3 force = vec3(0, 0, 0);
    for (int round = 0; round < 2; round++) refine_all(body, round ? DGFEM_REFINE_TWO : DGFEM_REFINE_EIGHT);
    assert_int_equal(body->mesh->element_count, 96);
    for (int c = 0; c < body->condition_count; c++) {
        const dgfem_condition *condition = &body->conditions[c];
        double volume = 0;
        switch (condition->kind) {
        case DGFEM_CONDITION_FIX_FACES: check_near(area_of(body, condition), 1, 20 * CHECK_EPSILON); break;
        case DGFEM_CONDITION_TRACTION:
        case DGFEM_CONDITION_PRESSURE: check_near(area_of(body, condition), 3, 50 * CHECK_EPSILON); break;
        case DGFEM_CONDITION_FIX_ELEMENTS:
        case DGFEM_CONDITION_BODY_FORCE:
            for (int i = 0; i < condition->count; i++) {
                const dgfem_element *e = &body->mesh->elements[condition->items[i]];
                volume += (double)e->volume;
                if (condition->kind == DGFEM_CONDITION_FIX_ELEMENTS) assert_int_equal(e->tag, 5);
            }
            check_near(volume, condition->kind == DGFEM_CONDITION_BODY_FORCE ? 1 : 0.5, 20 * CHECK_EPSILON);
            break;
        default: {
            dgfem_vec3 c0 = body->mesh->elements[condition->items[0]].centre;
            assert_int_equal(condition->count, 1);
            assert_true(check_distance(c0, condition->point) < 0.6);
        }
        }
    }
    for (int e = 0; e < body->mesh->element_count; e++) {
        dgfem_vec3 f = body->force[body->basis_start[e]]; /* of the constant function: the total */
        force.x += f.x, force.y += f.y, force.z += f.z;
    }
    check_near3(force, vec3(3e-3 + 1e-3, 6e-3, 1e-3), 10 * CHECK_EPSILON);
    check_status(dgfem_body_drag(body, pin, vec3(2.8, 0.3, 0.3)), DGFEM_OK);
    solve(body);
    check_status(dgfem_body_step(body, DGFEM_R(0.01), NULL), DGFEM_OK);
    dgfem_body_destroy(body);
}

/* Halving follows the stress: a bar stretched along a slanted direction, then turned in space. */
static void test_halves_across_the_stress(void **state) {
    (void)state;
    dgfem_body_desc desc = soft_desc();
    dgfem_body *body = make_box(&desc, 1, 1, 1, 1, 1, 1);
    double s = 0.01, stretch[9] = {1 + s / 2, s / 2, 0, s / 2, 1 + s / 2, 0, 0, 0, 1}, f[9];
    dgfem_mat3 turn = rotation_minus_identity(1, 2, -1, 2.0);
    for (int i = 0; i < 3; i++) turn.m[i][i] += 1;
    for (int i = 0; i < 9; i++) {
        f[i] = i % 4 == 0 ? -1 : 0;
        for (int k = 0; k < 3; k++) f[i] += (double)turn.m[i / 3][k] * stretch[3 * k + i % 3];
    }
    check_status(dgfem_body_set_affine(body, matrix(f), vec3(1, 0, 0)), DGFEM_OK);
    dgfem_refine_info info = refine_all(body, DGFEM_REFINE_TWO);
    double lambda = 0.3 / 1.3 / 0.4, mu = 1 / 2.6; /* of E = 1, nu = 0.3 */
    check_near(info.largest_stress, (lambda + 2 * mu) * s, DGFEM_REAL_IS_FLOAT ? 1e-5 : 1e-13);
    assert_int_equal(body->mesh->element_count, 2);
    for (int i = 0; i < body->mesh->face_count; i++) {
        const dgfem_face *face = &body->mesh->faces[i];
        if (face->element[1] == DGFEM_NONE) continue;
        double along = fabs((double)face->normal.x + (double)face->normal.y) / sqrt(2.0);
        check_near(along, 1, DGFEM_REAL_IS_FLOAT ? 1e-4 : 1e-12);
    }
    dgfem_body_destroy(body);
    body = make_box(&desc, 1, 1, 1, 1, 3, 1); /* no stress: across the longest edge */
    refine_all(body, DGFEM_REFINE_TWO);
    check_near(fabs((double)body->mesh->elements[0].centre.y - 1.5), 0.75, 10 * CHECK_EPSILON);
    dgfem_body_destroy(body);
}

/* ---- the stress decides ---- */

static void test_thresholds(void **state) {
    (void)state;
    dgfem_body_desc desc = soft_desc();
    dgfem_refine_desc refine = dgfem_default_refine_desc();
    dgfem_refine_info info;
    double young[4] = {1, 2, 4, 8}, small = 1e-3;
    dgfem_material materials[4];
    for (int e = 0; e < 4; e++)
        materials[e] = desc.material, materials[e].young = (dgfem_real)young[e], materials[e].poisson = 0;
    desc.materials = materials;
    dgfem_body *body = make_box(&desc, 4, 1, 1, 4, 1, 1);
    double linear[9] = {-small, 0, 0, 0, 0, 0, 0, 0, 0}; /* compression counts as tension does: 1, 2, 4, 8 mPa */
    check_status(dgfem_body_set_affine(body, matrix(linear), vec3(0, 0, 0)), DGFEM_OK);
    refine.refine_above = DGFEM_R(3e-3);
    check_status(dgfem_body_refine(body, &refine, &info), DGFEM_OK);
    check_near(info.largest_stress, 8e-3, DGFEM_REAL_IS_FLOAT ? 1e-6 : 1e-14);
    assert_int_equal(info.elements_split, 2);
    assert_int_equal(body->mesh->element_count, 18);
    refine.refine_above = 1, refine.merge_below = DGFEM_R(5e-3); /* now only the third cell's parts are to merge */
    check_status(dgfem_body_refine(body, &refine, &info), DGFEM_OK);
    assert_int_equal(info.elements_merged, 7);
    assert_int_equal(body->mesh->element_count, 11);
    check_status(dgfem_body_refine(body, &refine, &info), DGFEM_OK);
    assert_int_equal(info.elements_merged, 0);
    assert_int_equal(body->revision, 2);
    dgfem_body_destroy(body);

    body = make_box(&desc, 4, 1, 1, 4, 1, 1);
    check_status(dgfem_body_set_affine(body, matrix(linear), vec3(0, 0, 0)), DGFEM_OK);
    refine.how = DGFEM_REFINE_RAISE, refine.refine_above = DGFEM_R(3e-3), refine.merge_below = 0,
    refine.highest_degree = 2;
    for (int round = 0; round < 2; round++) check_status(dgfem_body_refine(body, &refine, &info), DGFEM_OK);
    assert_int_equal(info.degrees_raised, 0);
    for (int e = 0; e < 4; e++) assert_int_equal(body->degree[e], e < 2 ? 1 : 2);
    refine.refine_above = 1, refine.merge_below = DGFEM_R(5e-3);
    check_status(dgfem_body_refine(body, &refine, &info), DGFEM_OK);
    assert_int_equal(info.degrees_lowered, 1);
    for (int e = 0; e < 4; e++) assert_int_equal(body->degree[e], e < 3 ? 1 : 2);
    dgfem_body_destroy(body);

    body = make_box(&desc, 4, 1, 1, 4, 1, 1); /* the size limit: cells of 1, parts of 1/8 and 1/2 */
    check_status(dgfem_body_set_affine(body, matrix(linear), vec3(0, 0, 0)), DGFEM_OK);
    refine = dgfem_default_refine_desc();
    refine.refine_above = DGFEM_R(1e-4), refine.smallest = DGFEM_R(0.51);
    check_status(dgfem_body_refine(body, &refine, &info), DGFEM_OK);
    assert_int_equal(body->mesh->element_count, 4);
    refine.how = DGFEM_REFINE_TWO;
    check_status(dgfem_body_refine(body, &refine, &info), DGFEM_OK);
    assert_int_equal(body->mesh->element_count, 8);
    dgfem_body_destroy(body);
}

/* ---- coarsening ---- */

/* Ten rounds of refining, twice each, and coarsening: the elements are as many as before, and so is a field that the union
   can represent. */
static void test_there_and_back(void **state) {
    (void)state;
    check_random random = check_random_seeded(8);
    for (int how = DGFEM_REFINE_EIGHT; how <= DGFEM_REFINE_TWO; how++) {
        dgfem_body *body = make_loaded(2, NULL, NULL);
        int faces = 0;
        release_elements(body);
        set_parabola(body, body->displacement);
        set_parabola(body, body->velocity);
        check_parabola(body, &random, 20 * CHECK_EPSILON);
        totals t = sum_up(body);
        for (int round = 0; round < 10; round++) {
            double tolerance = (round + 1) * 300 * CHECK_EPSILON;
            refine_all(body, (dgfem_refine_action)how);
            refine_one(body, check_random_int(&random, body->mesh->element_count), (dgfem_refine_action)how);
            check_parabola(body, &random, tolerance);
            refine_all(body, DGFEM_REFINE_MERGE);
            assert_true(body->mesh->element_count > 6); /* one level at a time */
            refine_all(body, DGFEM_REFINE_MERGE);
            assert_int_equal(body->mesh->element_count, 6);
            check_parabola(body, &random, tolerance);
            check_totals(body, &t, 1, tolerance);
            assert_int_equal(body->family_count, 0);
            print_message("round %d: %d faces, %d vertices\n", round, body->mesh->face_count, body->mesh->vertex_count);
            if (how == DGFEM_REFINE_EIGHT && round == 1) faces = body->mesh->face_count;
        }
        if (how == DGFEM_REFINE_EIGHT)
            assert_in_range(body->mesh->face_count, faces, 2 * faces); /* no growth without end */
        check_status(dgfem_body_step(body, DGFEM_R(0.01), NULL), DGFEM_OK);
        dgfem_body_destroy(body);
    }
}

/* A random field is projected: momentum stays; a second merge of the same changes nothing. */
static void test_merging_keeps_momentum(void **state) {
    (void)state;
    check_random random = check_random_seeded(9);
    for (int degree = 1; degree <= 3; degree++) {
        dgfem_body *body = make_loaded(degree, NULL, NULL);
        refine_all(body, DGFEM_REFINE_EIGHT);
        randomize(body, &random);
        totals t = sum_up(body);
        dgfem_refine_info info = refine_all(body, DGFEM_REFINE_MERGE);
        assert_int_equal(info.elements_merged, 5 * 7); /* the held one stays apart */
        check_totals(body, &t, 0, 1000 * CHECK_EPSILON);
        dgfem_body_destroy(body);
    }
}

/* Families stay together only as far as they may. */
static void test_what_does_not_merge(void **state) {
    (void)state;
    dgfem_body_desc desc = soft_desc();
    dgfem_body *body = make_box(&desc, 2, 1, 1, 2, 1, 1);
    refine_one(body, 0, DGFEM_REFINE_EIGHT);
    int child = 0, other = 0;
    for (int e = 0; e < 9; e++)
        if (body->family[e] == 0) child = e;
        else other = e;
    dgfem_refine_info info = refine_one(body, other, DGFEM_REFINE_MERGE); /* has no family */
    assert_int_equal(info.elements_merged, 0);
    info = refine_one(body, child, DGFEM_REFINE_MERGE); /* the others are to stay */
    assert_int_equal(info.elements_merged, 0);
    refine_one(body, child, DGFEM_REFINE_RAISE);
    info = refine_all(body, DGFEM_REFINE_MERGE); /* one differs in degree */
    assert_int_equal(info.elements_merged, 0);
    refine_one(body, child, DGFEM_REFINE_LOWER);
    check_status(dgfem_body_set_body_force(body, &child, 1, vec3(1, 0, 0), NULL), DGFEM_OK);
    info = refine_all(body, DGFEM_REFINE_MERGE); /* one is loaded */
    assert_int_equal(info.elements_merged, 0);
    check_status(dgfem_body_remove_condition(body, body->conditions[0].id), DGFEM_OK);
    refine_one(body, child, DGFEM_REFINE_EIGHT);
    info = refine_all(body, DGFEM_REFINE_MERGE); /* one was split: its own parts come first */
    assert_int_equal(info.elements_merged, 7);
    info = refine_all(body, DGFEM_REFINE_MERGE);
    assert_int_equal(info.elements_merged, 7);
    assert_int_equal(body->mesh->element_count, 2);
    dgfem_body_destroy(body);
}

/* ---- accuracy on non-conforming meshes ---- */

static void linear_field(void *user, dgfem_vec3 x, dgfem_vec3 *u) {
    (void)user;
    *u = vec3(0.01 * (double)x.x + 0.02 * (double)x.y - 0.03 * (double)x.z + 0.05,
              -0.04 * (double)x.x + 0.05 * (double)x.y + 0.06 * (double)x.z - 0.1,
              0.07 * (double)x.x - 0.08 * (double)x.y + 0.09 * (double)x.z + 0.2);
}

/* The static solution with a linear displacement held all around is that displacement, whatever touches what. */
static void test_patch(void **state) {
    (void)state;
    check_random random = check_random_seeded(11);
    for (int degree = 1; degree <= 2; degree++) {
        dgfem_body_desc desc = soft_desc();
        int faces[MAX_FACES];
        double largest = 0;
        desc.degree = degree, desc.warp = 0;
        dgfem_body *body = make_box(&desc, 2, 2, 1, 2, 2, 1);
        plan p;
        memset(&p, 0, sizeof p);
        p.random = &random;
        randomize(body, &random); /* stresses in all directions for the halves */
        (void)carry_out(body, &p);
        if (degree == 2) (void)carry_out(body, &p);
        for (int round = 0; round < 5 && degree == 1; round++)
            refine_one(body, 0, DGFEM_REFINE_EIGHT); /* edges 1 : 32 */
        int count = all_boundary_faces(body, faces);
        check_status(dgfem_body_fix_faces_fn(body, faces, count, linear_field, NULL, NULL), DGFEM_OK);
        solve(body);
        for (int e = 0; e < body->mesh->element_count; e++) {
            dgfem_vec3 x = random_point(body->mesh, e, &random), expected;
            linear_field(NULL, x, &expected);
            double error = check_distance(dgfem_body_displacement(body, e, x), expected);
            if (!(error <= largest)) largest = error;
        }
        print_message("patch test, degree %d, %d elements: error %.2g\n", degree, body->mesh->element_count, largest);
        assert_true(largest <= (DGFEM_REAL_IS_FLOAT ? 3e-4 : 1e-11));
        dgfem_body_destroy(body);
    }
}

/* The paper's Fig. 8: a cantilever of 4 x 3 x 3 hexahedra under its weight becomes 274 elements by 1-to-8 splits, when the
   threshold is just below the stress of the upper and lower layer at the clamp and elements are split twice at most. */
static void test_adaptive_bar(void **state) {
    (void)state;
    static const int counts[2][3] = {{78, 274, 274}, {42, 48, 54}};
    for (int how = DGFEM_REFINE_EIGHT; how <= DGFEM_REFINE_TWO; how++) {
        dgfem_body_desc base = dgfem_default_body_desc();
        dgfem_refine_desc desc = dgfem_default_refine_desc();
        base.gravity.z = DGFEM_R(-0.3);
        desc.how = (dgfem_refine_action)how, desc.refine_above = 6490, desc.smallest = DGFEM_R(0.12);
        dgfem_body *body = make_box(&base, 4, 3, 3, 4.5, 1, 1);
        clamp_at_x(body, 0);
        for (int round = 0; round < 3; round++) {
            solve(body);
            check_status(dgfem_body_refine(body, &desc, NULL), DGFEM_OK);
            assert_int_equal(body->mesh->element_count, counts[how - DGFEM_REFINE_EIGHT][round]);
        }
        check_status(dgfem_mesh_check(body->mesh), DGFEM_OK);
        dgfem_body_destroy(body);
    }
}

/* ---- slivers ---- */

/* A box with a thin slice and a thin corner split off. */
static dgfem_body *make_slivers(const dgfem_hooks *hooks) {
    dgfem_grid_desc grid = dgfem_default_grid_desc();
    dgfem_body_desc desc = soft_desc();
    dgfem_body *body = NULL;
    dgfem_plane slice, corner;
    slice.normal = vec3(0, 0, 1), slice.offset = DGFEM_R(1e-3);
    corner.normal = vec3(1, 1, 1), corner.offset = DGFEM_R(3 - 0.05);
    grid.cells[0] = 2;
    if (hooks) grid.hooks = desc.hooks = *hooks;
    check_status(dgfem_mesh_create_grid(&grid, &desc.mesh), DGFEM_OK);
    check_status(dgfem_mesh_split_plane(desc.mesh, slice, 0, NULL), DGFEM_OK);
    check_status(dgfem_mesh_split_plane(desc.mesh, corner, 0, NULL), DGFEM_OK);
    check_status(dgfem_body_create(&desc, &body), DGFEM_OK);
    assert_int_equal(body->mesh->element_count, 5);
    return body;
}

static void test_slivers(void **state) {
    (void)state;
    check_random random = check_random_seeded(12);
    dgfem_body *body = make_slivers(NULL);
    int merged = -1;
    randomize(body, &random);
    totals t = sum_up(body);
    check_status(dgfem_body_merge_slivers(body, 0, &merged), DGFEM_OK);
    assert_int_equal(merged, 0);
    check_status(dgfem_body_merge_slivers(body, DGFEM_R(1e-5), &merged), DGFEM_OK);
    assert_int_equal(merged, 0);
    assert_int_equal(body->revision, 0);
    check_status(dgfem_body_merge_slivers(body, DGFEM_R(1e-2), &merged),
                 DGFEM_OK); /* slices by thickness, corner by volume */
    assert_int_equal(merged, 3);
    assert_int_equal(body->mesh->element_count, 2);
    check_status(dgfem_mesh_check(body->mesh), DGFEM_OK);
    check_totals(body, &t, 0, 1000 * CHECK_EPSILON);
    dgfem_body_destroy(body);

    body = make_slivers(NULL); /* what is held, or of another degree, stays */
    int thin = 0;
    for (int e = 0; e < 5; e++)
        if (body->mesh->elements[e].volume < body->mesh->elements[thin].volume) thin = e;
    check_status(dgfem_body_fix_elements(body, &thin, 1, NULL), DGFEM_OK);
    check_status(dgfem_body_merge_slivers(body, DGFEM_R(1e-2), &merged), DGFEM_OK);
    assert_int_equal(merged, 2);
    dgfem_body_destroy(body);
}

/* ---- bad input and failures ---- */

static dgfem_refine_action choose_nonsense(void *user, const dgfem_body *body, int element,
                                           dgfem_refine_action proposed) {
    (void)user, (void)body, (void)proposed;
    return (dgfem_refine_action)(element == 3 ? 17 : 0);
}

static void test_bad_input(void **state) {
    (void)state;
    check_host host;
    dgfem_hooks hooks = check_hooks(&host);
    dgfem_body *body = make_loaded(1, &hooks, NULL);
    dgfem_refine_desc desc = dgfem_default_refine_desc(), empty;
    dgfem_body before = *body;
    memset(&empty, 0, sizeof empty);
    check_status(dgfem_body_refine(NULL, &desc, NULL), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_body_refine(body, NULL, NULL), DGFEM_ERROR_DESCRIPTOR), check_logged(&host, "refine");
    check_status(dgfem_body_refine(body, &empty, NULL), DGFEM_ERROR_DESCRIPTOR), check_logged(&host, "refine");
    desc.how = DGFEM_REFINE_MERGE;
    check_status(dgfem_body_refine(body, &desc, NULL), DGFEM_ERROR_ARGUMENT), check_logged(&host, "how");
    desc = dgfem_default_refine_desc(), desc.refine_above = (dgfem_real)NAN;
    check_status(dgfem_body_refine(body, &desc, NULL), DGFEM_ERROR_ARGUMENT), check_logged(&host, "refine_above");
    desc.refine_above = 1, desc.merge_below = 2;
    check_status(dgfem_body_refine(body, &desc, NULL), DGFEM_ERROR_ARGUMENT), check_logged(&host, "merge_below");
    desc.merge_below = (dgfem_real)NAN;
    check_status(dgfem_body_refine(body, &desc, NULL), DGFEM_ERROR_ARGUMENT), check_logged(&host, "merge_below");
    desc = dgfem_default_refine_desc(), desc.smallest = -1;
    check_status(dgfem_body_refine(body, &desc, NULL), DGFEM_ERROR_ARGUMENT), check_logged(&host, "smallest");
    desc = dgfem_default_refine_desc(), desc.highest_degree = 4;
    check_status(dgfem_body_refine(body, &desc, NULL), DGFEM_ERROR_ARGUMENT), check_logged(&host, "degrees");
    desc.highest_degree = 1, desc.lowest_degree = 2;
    check_status(dgfem_body_refine(body, &desc, NULL), DGFEM_ERROR_ARGUMENT), check_logged(&host, "degrees");
    desc = dgfem_default_refine_desc(), desc.choose = choose_nonsense;
    check_status(dgfem_body_refine(body, &desc, NULL), DGFEM_ERROR_ARGUMENT),
        check_logged(&host, "action 17 for element 3");
    check_status(dgfem_body_merge_slivers(NULL, 0, NULL), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_body_merge_slivers(body, 1, NULL), DGFEM_ERROR_ARGUMENT), check_logged(&host, "ratio");
    check_status(dgfem_body_merge_slivers(body, (dgfem_real)NAN, NULL), DGFEM_ERROR_ARGUMENT),
        check_logged(&host, "ratio");
    assert_memory_equal(&before, body, sizeof before);
    desc = dgfem_default_refine_desc(), desc.refine_above = 0; /* no stress is not above zero */
    check_status(dgfem_body_refine(body, &desc, NULL), DGFEM_OK);
    assert_memory_equal(&before, body, sizeof before);
    dgfem_body_destroy(body);
    assert_int_equal(host.live, 0);
}

static dgfem_status refine_round(dgfem_body *body, plan *p) {
    dgfem_refine_desc desc = dgfem_default_refine_desc();
    desc.choose = follow_plan, desc.user = p;
    return dgfem_body_refine(body, &desc, NULL);
}

static dgfem_status merge_round(dgfem_body *body, plan *p) {
    (void)p;
    return dgfem_body_merge_slivers(body, DGFEM_R(1e-2), NULL);
}

/* Lets every allocation of a call fail: the body, whose bytes are compared, stays what it was. */
static void check_failures(dgfem_body *body, check_host *host, dgfem_status (*call)(dgfem_body *, plan *), plan *p) {
    dgfem_body before = *body;
    long live = host->live, fail = 1;
    dgfem_vec3 *u = (dgfem_vec3 *)malloc((size_t)body->basis_count * sizeof *u);
    assert_non_null(u);
    memcpy(u, body->displacement, (size_t)body->basis_count * sizeof *u);
    for (;; fail++) {
        host->fail_from = host->calls + fail;
        dgfem_status status = call(body, p);
        host->fail_from = 0;
        if (!status) break;
        check_status(status, DGFEM_ERROR_MEMORY);
        check_logged(host, "out of memory");
        assert_memory_equal(&before, body, sizeof before);
        assert_memory_equal(u, body->displacement, (size_t)body->basis_count * sizeof *u);
        assert_int_equal(host->live, live);
    }
    assert_true(fail > 20);
    check_status(dgfem_mesh_check(body->mesh), DGFEM_OK);
    free(u);
}

static void test_failures_change_nothing(void **state) {
    (void)state;
    static const dgfem_refine_action mixed[6] = {DGFEM_REFINE_EIGHT, DGFEM_REFINE_TWO,   DGFEM_REFINE_RAISE,
                                                 DGFEM_REFINE_NONE,  DGFEM_REFINE_EIGHT, DGFEM_REFINE_NONE};
    check_host host;
    dgfem_hooks hooks = check_hooks(&host);
    dgfem_body *body = make_loaded(1, &hooks, NULL);
    check_random random = check_random_seeded(13);
    plan p;
    memset(&p, 0, sizeof p);
    p.actions = mixed;
    randomize(body, &random);
    check_failures(body, &host, refine_round, &p);
    p.actions = NULL, p.all = DGFEM_REFINE_MERGE;
    check_failures(body, &host, refine_round, &p);
    dgfem_body_destroy(body);
    assert_int_equal(host.live, 0);
    body = make_slivers(&hooks);
    check_failures(body, &host, merge_round, NULL);
    dgfem_body_destroy(body);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_eight_boxes),
        cmocka_unit_test(test_other_shapes),
        cmocka_unit_test(test_splits_are_exact),
        cmocka_unit_test(test_conditions_survive),
        cmocka_unit_test(test_halves_across_the_stress),
        cmocka_unit_test(test_thresholds),
        cmocka_unit_test(test_there_and_back),
        cmocka_unit_test(test_merging_keeps_momentum),
        cmocka_unit_test(test_what_does_not_merge),
        cmocka_unit_test(test_patch),
        cmocka_unit_test(test_adaptive_bar),
        cmocka_unit_test(test_slivers),
        cmocka_unit_test(test_bad_input),
        cmocka_unit_test(test_failures_change_nothing),
    };
    return cmocka_run_group_tests_name("refine", tests, NULL, NULL);
}
