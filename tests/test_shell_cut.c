/* Shells that are cut: along edges, across elements, many times, with what holds them; and their render surface. */
#define DGFEM_IMPLEMENTATION
#include "dgfem_shell.h"
#include "check.h"
#include "check_shell.h"

/* The mesh hangs together: edges, elements and areas agree, and every node is used. */
static void check_topology(const dgfem_shell *shell) {
    char *used = (char *)calloc((size_t)shell->node_count, 1);
    for (int e = 0; e < shell->element_count; e++) {
        const dgfem_shell_element *element = &shell->elements[e];
        int corners = element->node_count / 2;
        for (int a = 0; a < element->node_count; a++) used[element->node[a]] = 1;
        for (int k = 0; k < corners; k++) {
            const dgfem_shell_edge *edge = &shell->edges[element->edge[k]];
            int other = edge->element[0] != e || edge->side[0] != k;
            assert_int_equal(edge->element[other], e);
            assert_int_equal(edge->side[other], k);
            assert_int_equal(edge->node[2], element->node[corners + k]);
            assert_int_equal(edge->node[other], element->node[k]);
            assert_int_equal(edge->node[!other], element->node[(k + 1) % corners]);
        }
        assert_true(element->area > 0);
    }
    for (int i = 0; i < shell->node_count; i++) assert_true(used[i]);
    free(used);
}

static int pieces_of(const dgfem_shell *shell) {
    int pieces;
    check_status(dgfem_shell_pieces(shell, &pieces, NULL), DGFEM_OK);
    return pieces;
}

static void edges_become_gaps_and_hinges(void **state) {
    dgfem_shell_desc desc = shell_desc();
    (void)state;
    for (int hinge = 0; hinge < 2; hinge++) {
        dgfem_shell *shell = shell_make(&desc, 4, 2, 0, map_flat);
        int edges[2], count = 0, nodes = shell->node_count;
        for (int i = 0; i < shell->edge_count; i++) /* the line x = 0.5 */
            if (fabs((double)shell->rest[shell->edges[i].node[0]].x - 0.5) +
                    fabs((double)shell->rest[shell->edges[i].node[1]].x - 0.5) <
                1e-6)
                edges[count++] = i;
        assert_int_equal(count, 2);
        if (!hinge) { /* one of the two first: a slit that opens the upper end only */
            check_status(dgfem_shell_cut_edges(shell, edges, 1, DGFEM_SHELL_GAP), DGFEM_OK);
            assert_int_equal(shell->node_count, nodes + 2);
            assert_int_equal(pieces_of(shell), 1);
            count = 0;
            for (int i = 0; i < shell->edge_count; i++)
                if (shell->edges[i].element[1] != DGFEM_NONE &&
                    fabs((double)shell->rest[shell->edges[i].node[2]].x - 0.5) < 1e-6)
                    edges[count++] = i;
            assert_int_equal(count, 1);
        }
        check_status(dgfem_shell_cut_edges(shell, edges, count, hinge ? DGFEM_SHELL_HINGE : DGFEM_SHELL_GAP), DGFEM_OK);
        check_topology(shell);
        assert_int_equal(shell->node_count, hinge ? nodes : nodes + 5);
        assert_int_equal(pieces_of(shell), hinge ? 1 : 2);
        assert_int_equal(shell->revision, hinge ? 1 : 2);
        if (!DGFEM_REAL_IS_FLOAT) { /* a hinge adds the turn about it; a gap another body's six */
            double *dense = shell_dense(shell, 0);
            assert_int_equal(shell_zero_modes(dense, 3 * shell->node_count, 1e-11), hinge ? 7 : 12);
            free(dense);
        }
        if (hinge) {
            check_status(dgfem_shell_cut_edges(shell, edges, count, DGFEM_SHELL_GLUED), DGFEM_OK);
            assert_int_equal(shell->edges[edges[0]].joint, DGFEM_SHELL_GLUED);
        }
        dgfem_shell_destroy(shell);
    }
}

static void plane_cuts_in_two(void **state) {
    (void)state;
    for (int triangles = 0; triangles < 2; triangles++)
        for (int curved = 0; curved < 2; curved++) {
            dgfem_shell_desc desc = shell_desc();
            dgfem_shell *shell = shell_make(&desc, 3, 3, triangles, curved ? map_curved : map_flat);
            dgfem_shell_cut_desc cut = dgfem_default_shell_cut_desc();
            dgfem_shell_cut_info info;
            double area = (double)dgfem_shell_area(shell), extent = curved ? 3 : 1;
            cut.plane = plane_of(1, 0.3, 0, 0.55 * extent);
            check_status(dgfem_shell_cut_plane(shell, &cut, &info), DGFEM_OK);
            check_topology(shell);
            assert_int_equal(info.pieces, 2);
            assert_true(info.elements_split >= 3 && info.edges_cut >= 3 && info.nodes_added > 0);
            check_near(dgfem_shell_area(shell), area, curved ? 1e-3 * area : 64 * CHECK_EPSILON);
            dgfem_shell_destroy(shell);
        }
}

/* A bounded cut is a slit: nothing falls apart, and beyond its ends the sheet is whole. */
static void bounded_cut_is_a_slit(void **state) {
    dgfem_shell_desc desc = shell_desc();
    dgfem_shell *shell = shell_make(&desc, 5, 5, 0, map_flat);
    dgfem_shell_cut_desc cut = dgfem_default_shell_cut_desc();
    dgfem_shell_cut_info info;
    int starts[200];
    (void)state;
    cut.plane = plane_of(0, 1, 0, 0.53);
    cut.bounded = 1;
    cut.from = at3(0.25, 0.53, 0), cut.to = at3(0.75, 0.53, 0);
    check_status(dgfem_shell_cut_plane(shell, &cut, &info), DGFEM_OK);
    check_topology(shell);
    assert_int_equal(info.pieces, 1);
    assert_int_equal(info.edges_cut, 3);
    assert_int_equal(dgfem_shell_boundary(shell, NULL, starts), 2); /* the rim and the slit */
    assert_int_equal(starts[2] - starts[1], 6);
    check_near(dgfem_shell_area(shell), 1, 64 * CHECK_EPSILON);
    dgfem_shell_destroy(shell);
}

/* Quadratic fields of the place in a flat sheet: triangles of six nodes carry them exactly. */
static dgfem_vec3 quadratic_position(dgfem_vec3 x) {
    double u = (double)x.x, v = (double)x.y;
    return at3(u + 0.02 * u * v, v - 0.03 * u * u + 0.01 * v, 0.1 * u * u - 0.2 * u * v + 0.05 * v * v);
}
static dgfem_vec3 quadratic_velocity(dgfem_vec3 x) {
    double u = (double)x.x, v = (double)x.y;
    return at3(0.3 * v * v, 0.1 - u * v, 0.2 * u + u * u);
}

/* A cut that only refines a mesh of triangles keeps shape, velocity, momenta and energies. */
static void refinement_keeps_the_state(void **state) {
    dgfem_shell_desc desc = shell_desc();
    (void)state;
    desc.corotational = 0; /* exact integrals: strains are linear in the parameters, and there are no kinks */
    desc.consistent_mass = 1;
    dgfem_shell *shell = shell_make(&desc, 2, 2, 1, map_flat);
    dgfem_shell_cut_desc cut = dgfem_default_shell_cut_desc();
    dgfem_energy energy[2];
    dgfem_vec3 linear[2], angular[2];
    for (int i = 0; i < shell->node_count; i++) {
        shell->position[i] = quadratic_position(shell->rest[i]);
        shell->velocity[i] = quadratic_velocity(shell->rest[i]);
    }
    cut.joint = DGFEM_SHELL_GLUED;
    cut.current = 0;
    cut.plane = plane_of(1, 0.4, 0, 0.6);
    int elements = shell->element_count;
    for (int k = 0; k < 2; k++) {
        check_status(dgfem_shell_energy(shell, &energy[k]), DGFEM_OK);
        check_status(dgfem_shell_momentum(shell, &linear[k], &angular[k]), DGFEM_OK);
        if (k == 0) check_status(dgfem_shell_cut_plane(shell, &cut, NULL), DGFEM_OK);
    }
    check_topology(shell);
    assert_true(shell->element_count > elements);
    assert_int_equal(pieces_of(shell), 1);
    for (int i = 0; i < shell->node_count; i++) {
        check_near3(shell->position[i], quadratic_position(shell->rest[i]), 16 * CHECK_EPSILON);
        check_near3(shell->velocity[i], quadratic_velocity(shell->rest[i]), 16 * CHECK_EPSILON);
    }
    check_near((double)energy[1].elastic / (double)energy[0].elastic, 1, 1e3 * CHECK_EPSILON);
    check_near((double)energy[1].kinetic / (double)energy[0].kinetic, 1, 64 * CHECK_EPSILON);
    check_near3(linear[1], linear[0], 64 * CHECK_EPSILON);
    check_near3(angular[1], angular[0], 64 * CHECK_EPSILON);
    dgfem_shell_destroy(shell);
}

/* Conditions follow: a fixed side stays fixed on both sides of a cut through it, loads keep their resultant. */
static void conditions_follow_a_cut(void **state) {
    dgfem_shell_desc desc = shell_desc();
    dgfem_shell *shell = shell_make(&desc, 3, 3, 0, map_flat);
    dgfem_shell_cut_desc cut = dgfem_default_shell_cut_desc();
    dgfem_shell_static_desc how = dgfem_default_shell_static_desc();
    int edges[256], nodes[64], count;
    dgfem_vec3 *f, sum = at3(0, 0, 0);
    (void)state;
    count = dgfem_shell_nodes_on_plane(shell, plane_of(0, 1, 0, 0), (dgfem_real)1e-5, nodes, 64);
    check_status(dgfem_shell_fix_nodes(shell, nodes, count, DGFEM_SHELL_XYZ, at3(0, 0, 0), NULL), DGFEM_OK);
    count = shell_edges(shell, plane_of(0, 1, 0, 1), edges);
    check_status(dgfem_shell_clamp(shell, edges, count, NULL), DGFEM_OK);
    count = shell_edges(shell, plane_of(1, 0, 0, 0), edges);
    check_status(dgfem_shell_set_line_load(shell, edges, count, at3(0, 0, -1), NULL), DGFEM_OK);
    check_status(dgfem_shell_set_pressure(shell, NULL, 0, 2, 0, NULL), DGFEM_OK);
    cut.plane = plane_of(1, 0.1, 0, 0.55); /* through both held sides */
    check_status(dgfem_shell_cut_plane(shell, &cut, NULL), DGFEM_OK);
    cut.plane = plane_of(0.1, 1, 0, 0.5); /* through the loaded side */
    check_status(dgfem_shell_cut_plane(shell, &cut, NULL), DGFEM_OK);
    check_topology(shell);
    assert_int_equal(pieces_of(shell), 4);
    for (int i = 0; i < shell->edge_count; i++) {
        const dgfem_shell_edge *edge = &shell->edges[i];
        int top = (double)shell->rest[edge->node[0]].y > 0.999999 && (double)shell->rest[edge->node[1]].y > 0.999999;
        assert_int_equal(edge->support != DGFEM_NONE, top);
    }
    for (int i = 0; i < shell->node_count; i++) {
        int fixed = 0;
        for (int k = 0; k < shell->conditions[0].count; k++) fixed |= shell->conditions[0].items[k] == i;
        assert_int_equal(fixed, (double)shell->rest[i].y < 1e-6);
    }
    f = (dgfem_vec3 *)calloc((size_t)shell->node_count, sizeof *f);
    memset(&shell->gravity_before, 0, sizeof shell->gravity_before);
    check_status(dgfem_shell_external_force(shell, f), DGFEM_OK);
    for (int i = 0; i < shell->node_count; i++) sum.z += f[i].z;
    check_near(sum.z, 1, 1e3 * CHECK_EPSILON); /* 2 - 1 */
    free(f);
    check_status(dgfem_shell_solve_static(shell, &how, NULL), DGFEM_OK); /* every piece is held */
    dgfem_shell_destroy(shell);
}

/* The one condition of this id. */
static const dgfem_shell_condition *condition_of(const dgfem_shell *shell, int id) {
    for (int c = 0; c < shell->condition_count; c++)
        if (shell->conditions[c].id == id) return &shell->conditions[c];
    fail_msg("no condition %d", id);
    return NULL;
}

/* A pin and a force at the middle of a side that is cut at x stay on the side of the cut where they were, at the
   nearest node there; a pin pulls no more than before. The side runs from 0 to 1: its parts have their middles at x / 2
   and (1 + x) / 2. */
static void loads_at_middles_stay_on_their_side(void **state) {
    static const double cuts[] = {0.2, 0.4, 0.45, 0.55, 0.6, 0.8};
    static const double expect[] = {0.6, 0.4, 0.45, 0.55, 0.6, 0.4};
    (void)state;
    for (int k = 0; k < 12; k++)
        for (int triangles = 0; triangles < 2; triangles++) {
            dgfem_shell_desc desc = shell_desc();
            dgfem_shell *shell = shell_make(&desc, 1, 1, triangles, map_flat);
            dgfem_shell_cut_desc cut = dgfem_default_shell_cut_desc();
            int node = shell_grid_nearest(shell, 0.5, 0, 0), pin, force, fixture, other = 0;
            double x = cuts[k % 6];
            check_status(dgfem_shell_pin(shell, node, 10, &pin), DGFEM_OK);
            check_status(dgfem_shell_drag(shell, pin, at3(0.5, 0, 0.25)), DGFEM_OK);
            check_status(dgfem_shell_add_force(shell, &node, 1, at3(1, 2, 3), &force), DGFEM_OK);
            check_status(dgfem_shell_fix_nodes(shell, &node, 1, DGFEM_SHELL_X, at3(0, 0, 0), &fixture), DGFEM_OK);
            cut.plane = plane_of(1, 0, 0, x);
            if (k >= 6) cut.plane = plane_of(-1, 0, 0, -x);
            check_status(dgfem_shell_cut_plane(shell, &cut, NULL), DGFEM_OK);
            check_topology(shell);
            assert_int_equal(condition_of(shell, pin)->count, 1);
            assert_int_equal(condition_of(shell, force)->count, 1);
            node = condition_of(shell, pin)->items[0];
            assert_int_equal(condition_of(shell, force)->items[0], node);
            check_near3(shell->rest[node], at3(expect[k % 6], 0, 0), 16 * CHECK_EPSILON);
            check_near3(condition_of(shell, pin)->vector, at3(expect[k % 6], 0, 0.25), 16 * CHECK_EPSILON);
            for (int e = 0; e < shell->element_count; e++) /* the node's elements are on the side of 0.5 */
                for (int a = 0; a < shell->elements[e].node_count; a++) {
                    dgfem_vec3 centre;
                    if (shell->elements[e].node[a] != node) continue;
                    check_status(dgfem_shell_evaluate(shell, e, (dgfem_real)0.3, (dgfem_real)0.3, &centre, NULL),
                                 DGFEM_OK);
                    assert_true(((double)centre.x > x) == (0.5 > x));
                    other++;
                }
            assert_true(other > 0);
            assert_int_equal(condition_of(shell, fixture)->count, 2); /* both copies of the crossing */
            dgfem_shell_destroy(shell);
        }
}

/* A load along an edge that comes apart stays with one side; pressures and edges' loads are not multiplied. */
static void loads_keep_their_resultants(void **state) {
    dgfem_shell_desc desc = shell_desc();
    (void)state;
    for (int triangles = 0; triangles < 2; triangles++) {
        dgfem_shell *shell = shell_make(&desc, 2, 2, triangles, map_flat);
        dgfem_shell_cut_desc cut = dgfem_default_shell_cut_desc();
        dgfem_vec3 *f;
        int edges[2], count = 0, nodes[3] = {0, 3, 3};
        for (int i = 0; i < shell->edge_count; i++)
            if (fabs((double)shell->rest[shell->edges[i].node[0]].x - 0.5) +
                    fabs((double)shell->rest[shell->edges[i].node[1]].x - 0.5) <
                1e-6)
                edges[count++] = i;
        assert_int_equal(count, 2);
        check_status(dgfem_shell_set_line_load(shell, edges, 2, at3(5, 0, 0), NULL), DGFEM_OK);
        check_status(dgfem_shell_add_force(shell, nodes, 3, at3(0, 1, 0), NULL), DGFEM_OK);
        check_status(dgfem_shell_set_pressure(shell, NULL, 0, 2, 0, NULL), DGFEM_OK);
        check_status(dgfem_shell_cut_edges(shell, edges, 2, DGFEM_SHELL_GAP), DGFEM_OK);
        assert_int_equal(pieces_of(shell), 2);
        cut.plane = plane_of(0.2, 1, 0, 0.4);
        check_status(dgfem_shell_cut_plane(shell, &cut, NULL), DGFEM_OK);
        assert_int_equal(pieces_of(shell), 4);
        f = (dgfem_vec3 *)calloc((size_t)shell->node_count, sizeof *f);
        check_status(dgfem_shell_external_force(shell, f), DGFEM_OK);
        double sum[3] = {0, 0, 0};
        for (int i = 0; i < shell->node_count; i++)
            sum[0] += (double)f[i].x, sum[1] += (double)f[i].y, sum[2] += (double)f[i].z;
        check_near3(at3(sum[0], sum[1], sum[2]), at3(5, 3, 2), 1e3 * CHECK_EPSILON);
        free(f);
        dgfem_shell_destroy(shell);
    }
}

/* A sheet hung by one side: a hundred random slits, straight through what the earlier ones have left, in its current
   shape, with steps between. */
static void hundred_random_cuts(void **state) {
    check_random random = check_random_seeded(82);
    dgfem_shell_desc desc = shell_desc();
    int nodes[64], cuts = 0, edges_cut = 0;
    (void)state;
    desc.gravity = at3(0, -1, -0.5);
    desc.damping_mass = 1;
    desc.step_iterations = 1;
    dgfem_shell *shell = shell_make(&desc, 3, 3, 0, map_flat);
    int count = dgfem_shell_nodes_on_plane(shell, plane_of(0, 1, 0, 1), (dgfem_real)1e-5, nodes, 64);
    check_status(dgfem_shell_fix_nodes(shell, nodes, count, DGFEM_SHELL_XYZ, at3(0, 0, 0), NULL), DGFEM_OK);
    for (; cuts < (DGFEM_REAL_IS_FLOAT ? 20 : 100);
         cuts++) { /* float comes with the sanitizers, which take their time */
        dgfem_shell_cut_desc cut = dgfem_default_shell_cut_desc();
        dgfem_shell_cut_info info;
        double angle = check_random_real(&random, 0, 6.3), length = check_random_real(&random, 0.05, 0.2);
        int at = check_random_int(&random, shell->node_count);
        dgfem_vec3 x = shell->position[at];
        cut.plane.normal = at3(cos(angle), sin(angle), check_random_real(&random, -0.3, 0.3));
        cut.plane.offset = cut.plane.normal.x * x.x + cut.plane.normal.y * x.y + cut.plane.normal.z * x.z;
        cut.bounded = 1;
        cut.from = x;
        cut.to = at3((double)x.x - length * sin(angle), (double)x.y + length * cos(angle), (double)x.z);
        check_status(dgfem_shell_cut_plane(shell, &cut, &info), DGFEM_OK);
        edges_cut += info.edges_cut;
        check_near(dgfem_shell_area(shell), 1, DGFEM_REAL_IS_FLOAT ? 1e-3 : 1e-12);
        if (cuts % 10) continue;
        check_topology(shell);
        check_status(dgfem_shell_step(shell, (dgfem_real)0.02, NULL), DGFEM_OK);
    }
    check_topology(shell);
    assert_true(edges_cut > cuts / 4);
    print_message("%d elements, %d nodes, %d edges cut, %d pieces\n", shell->element_count, shell->node_count,
                  edges_cut, pieces_of(shell));
    dgfem_shell_destroy(shell);
}

/* ---- failures ---- */

static dgfem_status cut_and_destroy(void *context, const dgfem_hooks *hooks) {
    dgfem_shell_desc desc = shell_desc();
    dgfem_shell *shell;
    dgfem_shell_cut_desc cut = dgfem_default_shell_cut_desc();
    int node = 0;
    shell_grid_describe((const shell_grid *)context, &desc);
    desc.hooks = *hooks;
    dgfem_status status = dgfem_shell_create(&desc, &shell);
    if (status) return status;
    status = dgfem_shell_fix_nodes(shell, &node, 1, DGFEM_SHELL_XYZ, at3(0, 0, 0), NULL);
    if (!status) status = dgfem_shell_set_pressure(shell, NULL, 0, 1, 0, NULL);
    cut.plane = plane_of(1, 0, 0, 0.3);
    int nodes = shell->node_count;
    dgfem_shell_cut_info info;
    if (!status) status = dgfem_shell_cut_plane(shell, &cut, &info);
    if (status) assert_int_equal(shell->node_count, nodes);
    check_topology(shell);
    nodes = shell->node_count;
    int inner = 0;
    while (shell->edges[inner].element[1] == DGFEM_NONE) inner++;
    if (!status) {
        status = dgfem_shell_cut_edges(shell, &inner, 1, DGFEM_SHELL_GAP);
        if (status) assert_int_equal(shell->node_count, nodes);
        if (status) assert_int_equal(shell->edges[inner].joint, DGFEM_SHELL_GLUED);
        check_topology(shell);
    }
    dgfem_shell_destroy(shell);
    return status;
}

static void survives_every_failing_allocation(void **state) {
    shell_grid grid;
    (void)state;
    memset(&grid, 0, sizeof grid);
    assert_true(shell_grid_add(&grid, 2, 1, 0, 0, map_flat, NULL));
    assert_true(check_every_allocation(cut_and_destroy, &grid) > 20);
    shell_grid_free(&grid);
}

static void refuses_bad_cuts(void **state) {
    dgfem_shell_desc desc = shell_desc();
    dgfem_shell_cut_desc cut = dgfem_default_shell_cut_desc();
    check_host host;
    int outer = 0, far = 99;
    (void)state;
    desc.hooks = check_hooks(&host);
    dgfem_shell *shell = shell_make(&desc, 2, 2, 0, map_flat);
    while (shell->edges[outer].element[1] != DGFEM_NONE) outer++;
    check_status(dgfem_shell_cut_edges(shell, &outer, 1, DGFEM_SHELL_GAP), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "on the boundary");
    check_status(dgfem_shell_cut_edges(shell, &far, 1, DGFEM_SHELL_GAP), DGFEM_ERROR_INDEX);
    check_logged(&host, "edge 99");
    int inner = 0;
    while (shell->edges[inner].element[1] == DGFEM_NONE) inner++;
    check_status(dgfem_shell_cut_edges(shell, &inner, 1, (dgfem_shell_joint)-1), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "unknown joint -1");
    cut.bounded = 1; /* without its ends */
    check_status(dgfem_shell_cut_plane(shell, &cut, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "from a point to itself");
    cut.plane.normal = at3(0, 0, 0);
    check_status(dgfem_shell_cut_plane(shell, &cut, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "normal is zero");
    cut = dgfem_default_shell_cut_desc();
    cut.snap = (dgfem_real)0.7;
    check_status(dgfem_shell_cut_plane(shell, &cut, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "snap");
    cut.cookie = 1;
    check_status(dgfem_shell_cut_plane(shell, &cut, NULL), DGFEM_ERROR_DESCRIPTOR);
    cut = dgfem_default_shell_cut_desc();
    cut.plane.offset = 7; /* misses */
    dgfem_shell_cut_info info;
    check_status(dgfem_shell_cut_plane(shell, &cut, &info), DGFEM_OK);
    assert_int_equal(info.elements_split + info.edges_cut + info.nodes_added, 0);
    assert_int_equal(info.pieces, 1);
    check_status(dgfem_shell_cut_edges(shell, &inner, 1, DGFEM_SHELL_GLUED), DGFEM_OK);
    cut.plane.offset = (dgfem_real)0.5; /* along edges that are glued already */
    cut.joint = DGFEM_SHELL_GLUED;
    check_status(dgfem_shell_cut_plane(shell, &cut, NULL), DGFEM_OK);
    assert_int_equal(shell->revision, 0); /* nothing has changed */
    cut.joint = DGFEM_SHELL_HINGE;
    for (int k = 0; k < 2; k++) {
        check_status(dgfem_shell_cut_plane(shell, &cut, NULL), DGFEM_OK);
        assert_int_equal(shell->revision, 1);
    }
    dgfem_shell_destroy(shell);
    assert_int_equal(host.live, 0);
}

/* ---- render surface ---- */

/* Twice the signed volume that triangles enclose, and whether each directed edge has its opposite. */
static int is_closed(const dgfem_shell_surface *surface, double *volume) {
    int closed = 1;
    *volume = 0;
    for (int t = 0; t < surface->triangle_count; t++) {
        const int *i = surface->triangles + 3 * t;
        dgfem_vec3 a = surface->positions[i[0]], b = surface->positions[i[1]], c = surface->positions[i[2]];
        *volume += ((double)a.x * ((double)b.y * (double)c.z - (double)b.z * (double)c.y) +
                    (double)a.y * ((double)b.z * (double)c.x - (double)b.x * (double)c.z) +
                    (double)a.z * ((double)b.x * (double)c.y - (double)b.y * (double)c.x)) /
                   6;
        for (int k = 0; k < 3; k++) {
            int found = 0;
            for (int s = 0; s < surface->triangle_count; s++)
                for (int l = 0; l < 3; l++)
                    found += surface->triangles[3 * s + l] == i[(k + 1) % 3] &&
                             surface->triangles[3 * s + (l + 1) % 3] == i[k];
            closed = closed && found == 1;
        }
    }
    return closed;
}

/* The middle surface is that of the elements: points of dgfem_shell_evaluate, normals too where one element has it. */
static void surface_is_that_of_the_elements(void **state) {
    check_random random = check_random_seeded(83);
    dgfem_shell_desc desc = shell_desc();
    dgfem_shell_surface_desc surface_desc = dgfem_default_shell_surface_desc();
    (void)state;
    surface_desc.sides = 1, surface_desc.subdivision = 3;
    for (int triangles = 0; triangles < 2; triangles++) {
        dgfem_shell *shell = shell_make(&desc, 2, 2, triangles, map_curved);
        dgfem_shell_surface *surface;
        for (int i = 0; i < shell->node_count; i++) {
            dgfem_vec3 x = shell->rest[i], u = check_random_vec3(&random, -0.05, 0.05);
            shell->position[i] = at3((double)(x.x + u.x), (double)(x.y + u.y), (double)(x.z + u.z));
        }
        check_status(dgfem_shell_surface_create(shell, &surface_desc, &surface), DGFEM_OK);
        assert_int_equal(surface->vertex_count, surface->point_count);
        for (int e = 0; e < shell->element_count; e++) {
            int index = surface->point_start[e];
            for (int j = 0; j <= 3; j++)
                for (int i = 0; i <= (triangles ? 3 - j : 3); i++, index++) {
                    double a = i / 3.0, b = j / 3.0;
                    int inside = i > 0 && j > 0 && (triangles ? i + j < 3 : i < 3 && j < 3);
                    dgfem_vec3 x, normal;
                    check_status(dgfem_shell_evaluate(shell, e, (dgfem_real)(triangles ? a : 2 * a - 1),
                                                      (dgfem_real)(triangles ? b : 2 * b - 1), &x, &normal),
                                 DGFEM_OK);
                    check_near3(surface->positions[surface->point_of[index]], x, 64 * CHECK_EPSILON);
                    if (inside) check_near3(surface->normals[surface->point_of[index]], normal, 64 * CHECK_EPSILON);
                }
            assert_int_equal(index, surface->point_start[e + 1]);
        }
        dgfem_shell_surface_destroy(surface);
        dgfem_shell_destroy(shell);
    }
}

/* Where the triangles are too many for an int: told, not tried. */
static void surface_of_too_many_triangles_is_refused(void **state) {
    dgfem_shell_surface_desc desc = dgfem_default_shell_surface_desc();
    dgfem_shell_surface *surface = NULL;
    dgfem_shell shell; /* a mesh of elements alone: nothing else may be looked at */
    check_host host;
    (void)state;
    desc.hooks = check_hooks(&host);
    memset(&shell, 0, sizeof shell);
    shell.element_count = 100000;
    shell.elements = (dgfem_shell_element *)calloc(100000, sizeof *shell.elements);
    for (int e = 0; e < shell.element_count; e++) shell.elements[e].node_count = e % 2 ? 8 : 6;
    desc.subdivision = 64;
    check_status(dgfem_shell_surface_create(&shell, &desc, &surface), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "100000 elements with subdivision 64");
    assert_null(surface);
    assert_int_equal(host.calls, 0);
    free(shell.elements);
}

static void surface_is_closed(void **state) {
    (void)state;
    for (int kind = 0; kind < 4; kind++) {
        dgfem_shell_desc desc = shell_desc();
        dgfem_shell_surface_desc surface_desc = dgfem_default_shell_surface_desc();
        dgfem_shell_surface *surface;
        double volume;
        dgfem_shell *shell = kind == 2   ? shell_make_mixed(&desc, 0)
                             : kind == 3 ? shell_make(&desc, 6, 1, 0, map_tube)
                                         : shell_make(&desc, 2, 2, kind, map_flat);
        surface_desc.subdivision = kind == 1 ? 3 : 2;
        check_status(dgfem_shell_surface_create(shell, &surface_desc, &surface), DGFEM_OK);
        assert_true(is_closed(surface, &volume));
        check_near(volume, 0.1 * (double)dgfem_shell_area(shell), kind == 3 ? 0.15 : 1e3 * CHECK_EPSILON);
        for (int i = 0; kind == 3 && i < surface->point_count; i++) {
            dgfem_vec3 x = surface->positions[i], n = surface->normals[i]; /* of the cylinder: radial */
            check_near((double)(n.x * x.x + n.y * x.y) / sqrt((double)(x.x * x.x + x.y * x.y)), 1, 1e-3);
        }
        dgfem_shell_cut_desc cut = dgfem_default_shell_cut_desc();
        cut.plane.offset = (dgfem_real)0.3;
        check_status(dgfem_shell_cut_plane(shell, &cut, NULL), DGFEM_OK);
        check_status(dgfem_shell_surface_update(surface, shell), DGFEM_ERROR_REVISION);
        dgfem_shell *other = shell_make(&desc, 4, 4, 0, map_flat); /* of the surface's revision */
        check_status(dgfem_shell_surface_update(surface, other), DGFEM_ERROR_REVISION);
        dgfem_shell_destroy(other);
        dgfem_shell_surface_destroy(surface);
        check_status(dgfem_shell_surface_create(shell, &surface_desc, &surface), DGFEM_OK);
        assert_true(is_closed(surface, &volume));
        dgfem_shell_surface_destroy(surface);
        dgfem_shell_destroy(shell);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(edges_become_gaps_and_hinges),
        cmocka_unit_test(plane_cuts_in_two),
        cmocka_unit_test(bounded_cut_is_a_slit),
        cmocka_unit_test(refinement_keeps_the_state),
        cmocka_unit_test(conditions_follow_a_cut),
        cmocka_unit_test(loads_at_middles_stay_on_their_side),
        cmocka_unit_test(loads_keep_their_resultants),
        cmocka_unit_test(hundred_random_cuts),
        cmocka_unit_test(survives_every_failing_allocation),
        cmocka_unit_test(refuses_bad_cuts),
        cmocka_unit_test(surface_is_closed),
        cmocka_unit_test(surface_is_that_of_the_elements),
        cmocka_unit_test(surface_of_too_many_triangles_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
