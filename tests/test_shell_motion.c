/* Shells in motion: free fall, vibration against beam theory, damping, contact, pins, moving fixtures. */
#define DGFEM_IMPLEMENTATION
#include "dgfem_shell.h"
#include "check.h"
#include "check_shell.h"

static dgfem_vec3 map_strip(void *user, double u, double v) {
    (void)user;
    return at3(2 * u, 0.5 * v, 0);
}

/* All nodes of a curved shell fall alike, with either mass matrix. */
static void free_fall_is_uniform(void **state) {
    (void)state;
    for (int consistent = 0; consistent < 2; consistent++) {
        dgfem_shell_desc desc = shell_desc();
        desc.gravity = at3(0, 0, -10);
        desc.consistent_mass = consistent;
        desc.step_tolerance = 0;
        dgfem_shell *shell = shell_make(&desc, 2, 1, 0, map_curved);
        dgfem_vec3 linear, angular;
        for (int step = 0; step < 10; step++) check_status(dgfem_shell_step(shell, (dgfem_real)0.01, NULL), DGFEM_OK);
        for (int i = 0; i < shell->node_count; i++) { /* h^2 g n (n + 1) / 2 */
            dgfem_vec3 x = shell->rest[i];
            check_near3(shell->velocity[i], at3(0, 0, -1), 2e5 * CHECK_EPSILON);
            check_near3(shell->position[i], at3((double)x.x, (double)x.y, (double)x.z - 0.055), 2e4 * CHECK_EPSILON);
        }
        check_status(dgfem_shell_momentum(shell, &linear, &angular), DGFEM_OK);
        check_near(linear.z, -(double)dgfem_shell_mass(shell), 1e5 * CHECK_EPSILON);
        check_near(shell->time, 0.1, 1e-6);
        dgfem_shell_destroy(shell);
    }
}

/* Forces of a shell on itself cancel: a spinning shell, deformed and shaking, keeps its momentum. Its angular momentum
   falls as that of implicit Euler does, by sum m v1 x v0 dt a step: where forces do not turn it,
   x1 x m v1 = x1 x m v0 = x0 x m v0 + dt v1 x m v0. */
static void momentum_is_kept(void **state) {
    (void)state;
    for (int consistent = 0; consistent < 2; consistent++) {
        check_random random = check_random_seeded(71);
        dgfem_shell_desc desc = shell_desc();
        dgfem_vec3 before, after, turning[2], first;
        const double dt = 0.002;
        desc.consistent_mass = consistent;
        desc.step_iterations = DGFEM_REAL_IS_FLOAT ? 4 : 20;
        desc.step_tolerance = (dgfem_real)(DGFEM_REAL_IS_FLOAT ? 1e-5 : 1e-12);
        desc.damping_stiffness = (dgfem_real)0.001;
        dgfem_shell *shell = shell_make_mixed(&desc, 0.2);
        for (int i = 0; i < shell->node_count; i++) {
            dgfem_vec3 x = shell->rest[i], noise = check_random_vec3(&random, -0.05, 0.05);
            shell->velocity[i] =
                at3(0.5 - 2 * (double)x.y + (double)noise.x, 2 * (double)x.x + (double)noise.y, -0.3 + (double)noise.z);
        }
        check_status(dgfem_shell_momentum(shell, &before, &first), DGFEM_OK);
        turning[0] = first;
        for (int step = 0; step < 5; step++) {
            dgfem_vec3 old[64];
            double lost = 0;
            assert_true(shell->node_count <= 64);
            memcpy(old, shell->velocity, (size_t)shell->node_count * sizeof *old);
            check_status(dgfem_shell_step(shell, (dgfem_real)dt, NULL), DGFEM_OK);
            check_status(dgfem_shell_momentum(shell, &after, &turning[1]), DGFEM_OK);
            check_near3(after, before, DGFEM_REAL_IS_FLOAT ? 1e-4 : 1e-10);
            for (int i = 0; i < shell->node_count; i++) {
                dgfem_vec3 v = shell->velocity[i], w = old[i];
                lost += dt * (double)shell->node_mass[i] * ((double)v.x * (double)w.y - (double)v.y * (double)w.x);
            }
            if (!consistent) check_near((double)(turning[1].z - turning[0].z), lost, 2e-4);
            turning[0] = turning[1];
        }
        check_near((double)turning[1].z / (double)first.z, 1, 0.005);
        dgfem_shell_destroy(shell);
    }
}

/* A step is the same in a frame that moves: as many iterations, the same motion besides. */
static void steps_do_not_see_the_frame(void **state) {
    const double speed = DGFEM_REAL_IS_FLOAT ? 16 : 4096;
    (void)state;
    for (int resting = 0; resting < 2; resting++) {
        dgfem_vec3 ends[2][64];
        int iterations[2] = {0, 0}, tip = 0;
        for (int moving = 0; moving < 2; moving++) {
            check_random random = check_random_seeded(73);
            dgfem_shell_desc desc = shell_desc();
            dgfem_shell_info info;
            desc.step_iterations = 20;
            dgfem_shell *shell = shell_make_mixed(&desc, 0.2);
            tip = shell->node_count - 1;
            for (int i = 0; i <= tip; i++) {
                shell->velocity[i] = check_random_vec3(&random, -1, 1);
                if (resting) shell->velocity[i] = at3(0, 0, 0);
                shell->velocity[i].x += (dgfem_real)(speed * moving);
            }
            check_status(dgfem_shell_step(shell, (dgfem_real)0.0625, &info), DGFEM_OK);
            iterations[moving] = info.iterations;
            for (int i = 0; i <= tip; i++) ends[moving][i] = shell->position[i];
            dgfem_shell_destroy(shell);
        }
        assert_int_equal(iterations[0], iterations[1]);
        if (resting) assert_int_equal(iterations[0], 1);
        for (int i = 0; i <= tip; i++) {
            dgfem_vec3 x = ends[1][i];
            check_near3(at3((double)x.x - 0.0625 * speed, (double)x.y, (double)x.z), ends[0][i],
                        1e3 * speed * CHECK_EPSILON);
        }
    }
}

/* A unit square of 1 kg/m^2 that spins about z through its corner, in closed form; and its weight's energy. */
static void consistent_mass_is_that_of_the_body(void **state) {
    dgfem_shell_desc desc = shell_desc();
    dgfem_energy energy;
    dgfem_vec3 linear, angular;
    (void)state;
    desc.consistent_mass = 1;
    desc.gravity = at3(-3, 0, 0);
    dgfem_shell *shell = shell_make_mixed(&desc, 0);
    for (int i = 0; i < shell->node_count; i++)
        shell->velocity[i] = at3(-(double)shell->rest[i].y, (double)shell->rest[i].x, 0);
    check_status(dgfem_shell_energy(shell, &energy), DGFEM_OK);
    check_status(dgfem_shell_momentum(shell, &linear, &angular), DGFEM_OK);
    check_near(energy.kinetic, 1.0 / 3, 64 * CHECK_EPSILON);
    check_near(energy.gravity, 1.5, 64 * CHECK_EPSILON);
    check_near3(linear, at3(-0.5, 0.5, 0), 64 * CHECK_EPSILON);
    check_near3(angular, at3(0, 0, 2.0 / 3), 64 * CHECK_EPSILON);
    dgfem_shell_destroy(shell);
}

/* First bending frequency of a clamped strip: 3.516 / L^2 sqrt(E I / (rho A)). */
static void strip_vibrates_as_a_beam(void **state) {
    dgfem_shell_desc desc = shell_desc();
    (void)state;
    for (int triangles = 0; triangles < 2 - DGFEM_REAL_IS_FLOAT; triangles++) { /* sanitizers take their time */
        int edges[256], steps = 90, crossings = 0;
        double first = 0, last = 0, previous = 0;
        desc.material.poisson = 0;
        desc.thickness = (dgfem_real)0.05;
        dgfem_shell *shell = shell_make(&desc, 3, 1, triangles, map_strip);
        int tip = shell_grid_nearest(shell, 2, 0, 0);
        check_status(dgfem_shell_clamp(shell, edges, shell_edges(shell, plane_of(1, 0, 0, 0), edges), NULL), DGFEM_OK);
        double omega = 3.516 / 4 * sqrt(1000 * 0.05 * 0.05 / 12 / 10), dt = 2 * 3.14159265 / omega / 60;
        for (int i = 0; i < shell->node_count; i++) {
            double s = (double)shell->rest[i].x / 2;
            shell->velocity[i] = at3(0, 0, 0.01 * s * s);
        }
        for (int step = 1; step <= steps; step++) {
            check_status(dgfem_shell_step(shell, (dgfem_real)dt, NULL), DGFEM_OK);
            double z = (double)shell->position[tip].z;
            if (step > 1 && z * previous < 0) { /* every half period */
                last = dt * (step - 1 + previous / (previous - z));
                if (crossings++ == 0) first = last;
            }
            previous = z;
        }
        assert_true(crossings >= 2);
        double period = 2 * (last - first) / (crossings - 1);
        check_near(period * omega / (2 * 3.14159265), 1, 0.02);
        dgfem_shell_destroy(shell);
    }
}

/* A plate set down on a plane comes to rest with the contact carrying its weight; thickness keeps its middle above. */
static void plate_rests_on_a_plane(void **state) {
    dgfem_shape_desc plane = dgfem_default_shape_desc();
    (void)state;
    for (int triangles = 0; triangles < 2; triangles++) {
        dgfem_shell_desc desc = shell_desc();
        dgfem_shell_info info;
        int id;
        desc.gravity = at3(0, 0, -10);
        desc.damping_mass = 2;
        dgfem_shell *shell = shell_make(&desc, 2, 2, triangles, map_flat);
        plane.plane.offset = (dgfem_real)-0.07; /* thickness 0.1: 0.02 to fall */
        check_status(dgfem_shell_add_plane(shell, &plane, &id), DGFEM_OK);
        for (int step = 0; step < 30; step++) check_status(dgfem_shell_step(shell, (dgfem_real)0.03, &info), DGFEM_OK);
        assert_true(info.contacts == shell->node_count);
        double push = 0; /* k (half - distance) summed up is the weight: 10 N */
        for (int i = 0; i < shell->node_count; i++) push += 10 * 100 * (0.05 - ((double)shell->position[i].z + 0.07));
        check_near(push, 10, 0.05);
        check_status(dgfem_shell_remove_shape(shell, id), DGFEM_OK); /* and falls when it is taken away */
        check_status(dgfem_shell_remove_shape(shell, id), DGFEM_ERROR_INDEX);
        dgfem_vec3 x = shell->position[0];
        check_status(dgfem_shell_step(shell, (dgfem_real)0.1, &info), DGFEM_OK);
        assert_int_equal(info.contacts, 0);
        check_near(shell->position[0].z, (double)x.z - 0.1 / 1.2, 0.02); /* h^2 g / (1 + h alpha) */
        dgfem_shell_destroy(shell);
    }
}

/* On a slope of 0.3 friction 0.5 holds and 0.1 lets go: a = g (sin - mu cos). */
static void friction_holds_or_slides(void **state) {
    (void)state;
    for (int slides = 0; slides < 2; slides++) {
        dgfem_shape_desc plane = dgfem_default_shape_desc();
        dgfem_shell_desc desc = shell_desc();
        double slope = 0.3, c = cos(atan(slope)), s = sin(atan(slope));
        desc.gravity = at3(10 * s, 0, -10 * c); /* the slope's own axes */
        dgfem_shell *shell = shell_make(&desc, 1, 1, 0, map_flat);
        plane.plane.offset = (dgfem_real)-0.05;
        plane.friction = (dgfem_real)(slides ? 0.1 : 0.5);
        check_status(dgfem_shell_add_plane(shell, &plane, NULL), DGFEM_OK);
        for (int step = 0; step < 50; step++) check_status(dgfem_shell_step(shell, (dgfem_real)0.02, NULL), DGFEM_OK);
        double speed = 0;
        for (int i = 0; i < shell->node_count; i++) speed += (double)shell->velocity[i].x / shell->node_count;
        check_near(speed, slides ? 10 * (s - 0.1 * c) : 0, slides ? 0.1 : 2e-3);
        dgfem_shell_destroy(shell);
    }
}

/* A sphere under the middle of a falling sheet holds it up from below, on whichever side its normals point. */
static void sphere_catches_a_sheet(void **state) {
    (void)state;
    for (int turned = 0; turned < 2 - DGFEM_REAL_IS_FLOAT; turned++) {
        dgfem_shell_desc desc = shell_desc();
        dgfem_shape_desc ball = dgfem_default_shape_desc();
        desc.gravity = at3(0, 0, turned ? 10 : -10);
        desc.thickness = (dgfem_real)0.02;
        desc.damping_stiffness = (dgfem_real)0.01;
        dgfem_shell *shell = shell_make(&desc, 4, 4, 0, map_flat);
        ball.centre = at3(0.5, 0.5, turned ? 0.4 : -0.4);
        ball.radius = (dgfem_real)0.3;
        ball.friction = 1;
        check_status(dgfem_shell_add_sphere(shell, &ball, NULL), DGFEM_OK);
        for (int step = 0; step < 12; step++) check_status(dgfem_shell_step(shell, (dgfem_real)0.05, NULL), DGFEM_OK);
        int middle = shell_grid_nearest(shell, 0.5, 0.5, 0);
        double top = fabs((double)shell->position[middle].z);
        check_near(top, 0.09, 0.02);
        for (int i = 0; i < shell->node_count; i++) {
            double x = (double)shell->position[i].x - 0.5, y = (double)shell->position[i].y - 0.5;
            double z = (double)shell->position[i].z - (double)ball.centre.z;
            assert_true(sqrt(x * x + y * y + z * z) > 0.29);
        }
        dgfem_shell_destroy(shell);
    }
}

/* A pin drags a corner to where it is told; a moving fixture reaches its target at the end of the step. */
static void pins_and_fixtures_move(void **state) {
    dgfem_shell_desc desc = shell_desc();
    int pin, fixture;
    (void)state;
    desc.damping_mass = 20;
    dgfem_shell *shell = shell_make(&desc, 1, 1, 1, map_flat);
    int corner = dgfem_shell_nearest_node(shell, at3(1, 1, 0)), other = dgfem_shell_nearest_node(shell, at3(0, 0, 0));
    check_status(dgfem_shell_pin(shell, corner, 500, &pin), DGFEM_OK);
    check_status(dgfem_shell_fix_nodes(shell, &other, 1, DGFEM_SHELL_XYZ, at3(0, 0, 0), &fixture), DGFEM_OK);
    check_status(dgfem_shell_drag(shell, pin, at3(1, 1, 0.3)), DGFEM_OK);
    for (int step = 1; step <= 25; step++) {
        check_status(dgfem_shell_move_fixture(shell, fixture, at3(0, 0, 0.012 * step)), DGFEM_OK);
        check_status(dgfem_shell_step(shell, (dgfem_real)0.02, NULL), DGFEM_OK);
        check_near3(shell->position[other], at3(0, 0, 0.012 * step), 8 * CHECK_EPSILON);
    }
    for (int step = 1; step <= 30; step++) check_status(dgfem_shell_step(shell, (dgfem_real)0.2, NULL), DGFEM_OK);
    check_near(shell->position[corner].z, 0.3, 0.01);
    check_status(dgfem_shell_remove_condition(shell, pin), DGFEM_OK);
    dgfem_shell_destroy(shell);
}

/* A clamp that turns by large angles in steps, about an axis away from it, carries a shell that moves with it: nothing
   strains it, so stiffness damping has nothing to damp, at its supports either. */
static void damping_does_not_hold_what_is_carried(void **state) {
    (void)state;
    for (int kind = 0; kind < 4; kind++) {
        dgfem_shell_desc desc = shell_desc();
        int edges[256], id, linear = kind >= 2, count;
        const double dt = 0.01, angle = linear ? 1e-4 : DGFEM_REAL_IS_FLOAT ? 0.1 : 0.5;
        desc.material.density = (dgfem_real)(DGFEM_REAL_IS_FLOAT ? 1e-5 : 1e-9); /* nothing else pulls at it */
        desc.damping_stiffness = (dgfem_real)0.1;
        desc.corotational = !linear;
        desc.step_iterations = 30;
        desc.step_tolerance = (dgfem_real)(DGFEM_REAL_IS_FLOAT ? 1e-4 : 1e-10);
        dgfem_shell *shell = shell_make(&desc, 2, 2, kind % 2, map_flat);
        count = shell_edges(shell, plane_of(1, 0, 0, 0), edges);
        check_status(dgfem_shell_clamp(shell, edges, count, &id), DGFEM_OK);
        for (int step = 1; step <= 3; step++) { /* x -> R (x - c) + c, c = (-1, 0, 0), about y */
            double c = cos(step * angle), s = sin(step * angle);
            dgfem_mat3 r;
            memset(&r, 0, sizeof r);
            r.m[0][0] = r.m[2][2] = (dgfem_real)c, r.m[1][1] = 1;
            r.m[0][2] = (dgfem_real)-s, r.m[2][0] = (dgfem_real)s;
            check_status(dgfem_shell_move_clamp(shell, id, r, at3(c - 1, 0, s)), DGFEM_OK);
            check_status(dgfem_shell_step(shell, (dgfem_real)dt, NULL), DGFEM_OK);
            for (int i = 0; i < shell->node_count; i++) {
                double x = (double)shell->rest[i].x + 1;
                check_near3(shell->position[i], at3(c * x - 1, (double)shell->rest[i].y, s * x),
                            linear                ? (DGFEM_REAL_IS_FLOAT ? 1e-6 : 2e-7)
                            : DGFEM_REAL_IS_FLOAT ? 1e-3
                                                  : 1e-6);
            }
        }
        dgfem_shell_destroy(shell);
    }
}

/* A bent strip that is let go creeps back as slowly as its damping lets it: without mass, w = w0 / (1 + h / beta)^n. */
static void damping_slows_bending(void **state) {
    dgfem_shell_desc desc = shell_desc();
    dgfem_shell_static_desc how = dgfem_default_shell_static_desc();
    int edges[256], id;
    (void)state;
    desc.material.density = (dgfem_real)1e-6;
    desc.damping_stiffness = (dgfem_real)0.5;
    dgfem_shell *shell = shell_make(&desc, 3, 1, 0, map_strip);
    int tip = shell_grid_nearest(shell, 2, 0, 0), count = shell_edges(shell, plane_of(1, 0, 0, 0), edges);
    check_status(dgfem_shell_clamp(shell, edges, count, NULL), DGFEM_OK);
    count = shell_edges(shell, plane_of(1, 0, 0, 2), edges);
    check_status(dgfem_shell_set_line_load(shell, edges, count, at3(0, 0, 1e-3), &id), DGFEM_OK);
    check_status(dgfem_shell_solve_static(shell, &how, NULL), DGFEM_OK);
    double first = (double)shell->position[tip].z;
    check_status(dgfem_shell_remove_condition(shell, id), DGFEM_OK);
    assert_true(first > 0.01);
    for (int step = 1; step <= 4; step++) {
        check_status(dgfem_shell_step(shell, (dgfem_real)0.1, NULL), DGFEM_OK);
        check_near((double)shell->position[tip].z / first, pow(1.2, -step), 0.01);
    }
    dgfem_shell_destroy(shell);
}

/* Implicit Euler only loses energy, however large the step, and never blows up. */
static void large_steps_are_stable(void **state) {
    check_random random = check_random_seeded(72);
    (void)state;
    for (int triangles = 0; triangles < 2; triangles++) {
        dgfem_shell_desc desc = shell_desc();
        int edges[256];
        desc.material.young = (dgfem_real)1e6;
        desc.step_iterations = 40;
        desc.thickness = (dgfem_real)0.01;
        desc.gravity = at3(0, 0, -10);
        dgfem_shell *shell = shell_make(&desc, 2, 2, triangles, map_flat);
        check_status(dgfem_shell_clamp(shell, edges, shell_edges(shell, plane_of(1, 0, 0, 0), edges), NULL), DGFEM_OK);
        for (int i = 0; i < shell->node_count; i++) shell->velocity[i] = check_random_vec3(&random, -5, 5);
        dgfem_energy energy;
        check_status(dgfem_shell_energy(shell, &energy), DGFEM_OK);
        double last = (double)(energy.kinetic + energy.elastic + energy.gravity);
        for (int step = 0; step < 15; step++) {
            check_status(dgfem_shell_step(shell, (dgfem_real)0.02, NULL), DGFEM_OK);
            check_status(dgfem_shell_energy(shell, &energy), DGFEM_OK);
            double now = (double)(energy.kinetic + energy.elastic + energy.gravity);
            assert_true(now < last);
            last = now;
        }
        dgfem_shell_destroy(shell);
    }
}

/* Nothing is allocated once the shell stands. */
static void steps_allocate_nothing(void **state) {
    dgfem_shell_desc desc = shell_desc();
    dgfem_shape_desc plane = dgfem_default_shape_desc();
    dgfem_shell_static_desc how = dgfem_default_shell_static_desc();
    check_host host;
    int edges[256];
    (void)state;
    desc.hooks = check_hooks(&host);
    desc.gravity = at3(0, 0, -1);
    dgfem_shell *shell = shell_make(&desc, 2, 1, 0, map_flat);
    plane.plane.offset = (dgfem_real)-0.06;
    check_status(dgfem_shell_add_plane(shell, &plane, NULL), DGFEM_OK);
    check_status(dgfem_shell_clamp(shell, edges, shell_edges(shell, plane_of(1, 0, 0, 0), edges), NULL), DGFEM_OK);
    long calls = host.calls;
    for (int step = 0; step < 5; step++) check_status(dgfem_shell_step(shell, (dgfem_real)0.05, NULL), DGFEM_OK);
    check_status(dgfem_shell_solve_static(shell, &how, NULL), DGFEM_OK);
    assert_int_equal(host.calls, calls);
    assert_int_equal(host.log_count, 0);
    dgfem_shell_destroy(shell);
    assert_int_equal(host.live, 0);
}

/* Ranges of odd sizes, the last first: as threads might take them. */
static void scattered_for(void *user, int count, int grain, dgfem_range_fn fn, void *context) {
    int size = grain > 3 ? grain - 3 : 1, first = count;
    ++*(long *)user;
    while (first > 0) {
        int last = first;
        first = last > size ? last - size : 0;
        fn(context, first, last);
        size = size % 11 + 1;
    }
}

/* The host's parallel loop changes no bit of a static solve or a motion with contact and damping. */
static void any_division_of_loops_gives_the_same_bits(void **state) {
    dgfem_vec3 ends[2][256];
    long loops = 0;
    int nodes = 0;
    (void)state;
    for (int divided = 0; divided < 2; divided++) {
        dgfem_shell_desc desc = shell_desc();
        dgfem_shell_static_desc how = dgfem_default_shell_static_desc();
        dgfem_shape_desc plane = dgfem_default_shape_desc();
        int edges[256];
        desc.gravity = at3(0, 0, -1);
        desc.damping_stiffness = (dgfem_real)0.01;
        if (divided) desc.hooks.parallel_for = scattered_for, desc.hooks.parallel_for_user = &loops;
        dgfem_shell *shell = shell_make(&desc, 5, 5, 1, map_flat);
        nodes = shell->node_count;
        assert_true(nodes <= 256);
        check_status(dgfem_shell_clamp(shell, edges, shell_edges(shell, plane_of(1, 0, 0, 0), edges), NULL), DGFEM_OK);
        check_status(dgfem_shell_solve_static(shell, &how, NULL), DGFEM_OK);
        check_status(dgfem_shell_set_gravity(shell, at3(0, 1, -5)), DGFEM_OK);
        plane.plane.offset = (dgfem_real)-0.2;
        check_status(dgfem_shell_add_plane(shell, &plane, NULL), DGFEM_OK);
        for (int step = 0; step < 3; step++) check_status(dgfem_shell_step(shell, (dgfem_real)0.05, NULL), DGFEM_OK);
        memcpy(ends[divided], shell->position, (size_t)nodes * sizeof(dgfem_vec3));
        dgfem_shell_destroy(shell);
    }
    assert_true(loops > 10);
    assert_memory_equal(ends[0], ends[1], (size_t)nodes * sizeof(dgfem_vec3));
}

/* The hung sheet's rest state in motion is that of the static solve. */
static void motion_ends_in_equilibrium(void **state) {
    dgfem_shell_desc desc = shell_desc();
    dgfem_shell_static_desc how = dgfem_default_shell_static_desc();
    int edges[256];
    (void)state;
    desc.gravity = at3(0, 0, -1);
    desc.damping_mass = 3;
    desc.consistent_mass = 1; /* weighs as the static load does */
    dgfem_shell *shell = shell_make(&desc, 2, 1, 0, map_flat);
    check_status(dgfem_shell_clamp(shell, edges, shell_edges(shell, plane_of(1, 0, 0, 0), edges), NULL), DGFEM_OK);
    for (int step = 0; step < 60; step++) check_status(dgfem_shell_step(shell, (dgfem_real)0.3, NULL), DGFEM_OK);
    int tip = shell_grid_nearest(shell, 1, 0, 0);
    dgfem_vec3 moved = shell->position[tip];
    assert_true((double)moved.z < -0.1);
    check_status(dgfem_shell_solve_static(shell, &how, NULL), DGFEM_OK);
    check_near3(shell->position[tip], moved, 2e-3);
    dgfem_shell_destroy(shell);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(free_fall_is_uniform),
        cmocka_unit_test(momentum_is_kept),
        cmocka_unit_test(strip_vibrates_as_a_beam),
        cmocka_unit_test(plate_rests_on_a_plane),
        cmocka_unit_test(friction_holds_or_slides),
        cmocka_unit_test(sphere_catches_a_sheet),
        cmocka_unit_test(pins_and_fixtures_move),
        cmocka_unit_test(large_steps_are_stable),
        cmocka_unit_test(motion_ends_in_equilibrium),
        cmocka_unit_test(steps_allocate_nothing),
        cmocka_unit_test(consistent_mass_is_that_of_the_body),
        cmocka_unit_test(steps_do_not_see_the_frame),
        cmocka_unit_test(damping_does_not_hold_what_is_carried),
        cmocka_unit_test(any_division_of_loops_gives_the_same_bits),
        cmocka_unit_test(damping_slows_bending),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
