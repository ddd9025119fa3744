/* dgfem.h - deformable solids by discontinuous Galerkin finite elements on arbitrary polyhedra

   A single-header library in C99 (also C++). It cuts a closed triangle surface into polyhedra with a hexahedral grid,
   moves them as one elastic body, and carries the original surface along as a smooth skin. It needs libc and libm,
   nothing else: no build system, no threads of its own, no global state.

   The method is that of P. Kaufmann, S. Martin, M. Botsch, M. Gross, "Flexible simulation of deformable models using
   discontinuous Galerkin FEM" (2009), with corrections. Equation numbers in comments refer to that paper.


   HOW TO BUILD IT IN

   In exactly one C or C++ file:

       #define DGFEM_IMPLEMENTATION
       #include "dgfem.h"

   and everywhere else only #include "dgfem.h". Link with -lm where that is a library of its own.


   CONFIGURATION

   Define these before the #include, the same in every file that includes it; all are optional.

       DGFEM_IMPLEMENTATION   compiles the function bodies here; in one file only
       DGFEM_REAL             float or double, the type behind dgfem_real; default double. The two do not link together.
       DGFEM_STATIC           all functions are static: the library is private to the one file that implements it
       DGFEM_API              what stands before each public function; default extern (extern "C" in C++), or static
       DGFEM_ASSERT(x)        checks of internal invariants; default assert(x), so NDEBUG takes them away
       DGFEM_NO_SIMD          plain C only; else gcc and clang compile dense kernels for several instruction sets, and the
                              best one that the machine has is chosen at run time
       DGFEM_USE_BLAS         large fronts of the Cholesky factorization go to cblas_dgemm (or sgemm); link with a BLAS

   No function prints, aborts or exits. Memory, log, threads and clock come in through dgfem_hooks, a member of each
   descriptor; all zero means libc's allocator, silence, one thread, no clock.


   HOW IT IS USED

   Every creating function takes a descriptor and returns a dgfem_status:

       dgfem_grid_desc desc = dgfem_default_grid_desc();   fills in every member, and a mark that this was done
       desc.cells[0] = 8;                                   change what should differ
       dgfem_status status = dgfem_mesh_create_grid(&desc, &mesh);
       if (status != DGFEM_OK) puts(dgfem_status_text(status));

   Zero always means zero, never "default". DGFEM_OK is 0. A call that fails has changed nothing, has freed what it
   took, and has logged one line that names the offender (face, edge, vertex, member). Structs may be read freely and
   are changed through functions. What was created is destroyed by the function of that name; destroying NULL is fine.

   From triangles to motion:

       dgfem_mesh_create_slices     a closed surface and a grid        -> a mesh of polyhedra
       dgfem_body_create            a mesh and a material              -> a body (which takes the mesh over)
       dgfem_body_fix_faces, _add_plane, _add_sphere, _set_traction    what holds it, what it touches, what pulls
       dgfem_skin_create            a body and the surface's vertices  -> a skin
       dgfem_body_step              advances the body, once a frame or several times
       dgfem_skin_update            moves the skin along; dgfem_skin_positions copies it into your vertex buffer

   The building blocks are public too: polyhedra with exact integrals of all monomials up to degree 6, plane splits,
   a symmetric block matrix with a sparse Cholesky factorization and conjugate gradients, polar rotations, symmetric
   eigenvectors.


   A WHOLE PROGRAM

       #define DGFEM_IMPLEMENTATION
       #include "dgfem.h"
       #include <stdio.h>

       int main(void) {
           // An octahedron of 1 m radius: six vertices, eight triangles, counter-clockwise from outside.
           const double vertices[] = {1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1};
           const int triangles[] = {0, 2, 4, 2, 1, 4, 1, 3, 4, 3, 0, 4, 2, 0, 5, 1, 2, 5, 3, 1, 5, 0, 3, 5};
           float positions[18];

           // 1. Cut it into polyhedra: 4 cubic cells along each axis.
           dgfem_slice_desc slices = dgfem_default_slice_desc();
           slices.vertices = dgfem_points_in_double(vertices, 6);
           slices.triangles = triangles;
           slices.triangle_count = 8;
           slices.cells = 4;
           dgfem_mesh *mesh;
           dgfem_status status = dgfem_mesh_create_slices(&slices, &mesh);
           if (status) return puts(dgfem_status_text(status)), 1;

           // 2. Make it a body of soft rubber. From here on the body owns the mesh.
           dgfem_body_desc desc = dgfem_default_body_desc();
           desc.mesh = mesh;
           desc.material.young = DGFEM_R(2e5);
           desc.material.poisson = DGFEM_R(0.4);
           desc.damping_stiffness = DGFEM_R(0.01);
           dgfem_body *body;
           if (dgfem_body_create(&desc, &body)) return dgfem_mesh_destroy(mesh), 1;

           // 3. Put a floor under it, 2 m below its centre.
           dgfem_shape_desc floor_desc = dgfem_default_shape_desc();
           floor_desc.plane.normal.z = 1;
           floor_desc.plane.offset = -2;
           if (dgfem_body_add_plane(body, &floor_desc, NULL)) return 1;

           // 4. Let its surface follow as a skin.
           dgfem_skin_desc skin_desc = dgfem_default_skin_desc();
           skin_desc.vertices = slices.vertices;
           skin_desc.triangles = triangles;
           skin_desc.triangle_count = 8;
           dgfem_skin *skin;
           if (dgfem_skin_create(body, &skin_desc, &skin)) return 1;

           // 5. Two seconds, sixty frames each.
           for (int frame = 1; frame <= 120; frame++) {
               if (dgfem_body_step(body, DGFEM_R(1) / 60, NULL)) return 1;
               if (dgfem_skin_update(skin, body)) return 1;
               if (dgfem_skin_positions(skin, dgfem_points_out_float(positions, 6))) return 1;
               if (frame % 30 == 0) printf("%3.1f s: lowest vertex at z = %.1f\n", body->time, (double)positions[17]);
           }
           dgfem_skin_destroy(skin);
           dgfem_body_destroy(body);
           return 0;
       }


   CUTTING

   A blade meets the body where it is now, in world space. Glue between elements goes, elements that the blade passes are
   split, and nothing else changes: no remeshing, no jump, and the next step may follow at once.

       dgfem_cut_desc cut = dgfem_default_cut_desc();
       cut.skins = &skin, cut.skin_count = 1;      render meshes that are to be cut along
       dgfem_body_cut_plane(body, plane, &cut, &info);
       dgfem_body_cut_polygon(body, dgfem_points_in_float(corners, 4), &cut, &info);
       dgfem_body_cut_surface(body, points, triangles, 2, &cut, &info);    the area a moving edge has swept
       dgfem_body_pieces(body, NULL, pieces, 16, &count);                  what hangs together now

   Elements and faces are numbered anew by every change of topology, and body->revision grows. Conditions, materials and
   tags stay on the parts, under the same ids. A skin that was not named in the descriptor refuses to update until
   dgfem_skin_renew. A call that fails, whatever the reason, leaves the body and the skins bit for bit what they were.

   A blade that sweeps through a moving body should take the place that its edge had at the last step along with the
   material, or what moved through between the steps stays glued. A skin gains vertices with every cut, and where strokes
   through one place do not quite meet its walls have cracks and small spikes: under many strokes draw dgfem_surface
   instead.


   WHAT IT DOES NOT DO

   - Materials other than isotropic linear ones. Large rotations are followed (stiffness warping, one rotation per
     element); the law between strain and stress is linear, so that large strains are plausible rather than accurate.
   - Contact between bodies or of a body with itself. Contact shapes are planes and spheres, by penalty: things sink
     in a little, in proportion to their weight.
   - Repairing surfaces. Open, inside-out or degenerate ones are refused with the offender named. A surface that crosses
     itself is not noticed.
   - Hard constraints on faces or points. Fixed faces are held weakly, by the same terms that glue elements together,
     with a small residue on coarse meshes that vanishes with refinement; pins are springs. Only whole elements can be
     held exactly (dgfem_body_fix_elements).
   - Reading or writing files, drawing, threads of its own.
   - Calls on the same object from two threads at once. Different objects are independent.


   THE SOLVER

   A step solves one linear system for the velocities, to an error that nobody sees: dgfem_body_desc.velocity_tolerance,
   1e-3 of the mean speed. Linear momentum is kept to round-off whatever the tolerance. Members of dgfem_body_desc.solver:

       DGFEM_SOLVER_AUTO       takes what pays, counted in operations: mostly an earlier factorization, turned with the
                               elements, one to three iterations a step; sweeps after a cut, where there is none
       DGFEM_SOLVER_STALE      the former alone
       DGFEM_SOLVER_SWEEPS     the latter alone: ten to thirty iterations a step, each little more than a product with
                               the matrix; no step is ever much dearer than another, and memory grows with the body
       DGFEM_SOLVER_CHOLESKY   factors in every step: exact, and the same velocities from the same state
       DGFEM_SOLVER_PCG        block-Jacobi to a given residual (solver_tolerance)

   With AUTO and STALE some steps factor, and cost as much as Cholesky's. dgfem_step_info tells what a step did.


   NUMERIC LIMITS

   - Units are yours, if consistent; the comments use SI. Geometry is measured about each element's own centre, so that
     an object far from the origin loses only what storing its coordinates loses: at a distance of 10^k times its size
     k of some sixteen decimal digits in double, of some seven in float.
   - Moments (dgfem_polyhedron_moments) are exact but for round-off of about 1e-15 h^d V (float: 1e-6 h^d V) about a
     centre close to the polyhedron; h is its radius, V its volume, d the degree. About a far centre they lose digits by
     their nature.
   - Cells of the slicing grid may be much larger or smaller than the triangles. Slivers smaller than 1e-3 of a cell
     are merged by default; with `sliver` 0 they stay, and cost accuracy of the linear solver, not correctness.
   - Elements may be flat or stretched, by 1:100 and more; the condition of the matrix grows with the stretch.
   - Poisson's ratio: -1 < nu < 0.5. The default penalty does not lock at 0.499; loads that change the volume of a
     nearly incompressible body are answered with an error that grows like lambda/mu h^2.
   - One layer of elements of degree 1 bends 40 to 65 % too softly with the default eta_rest 0.5; two layers or degree 2
     are good, or eta_rest = (1 + nu) / 2.
   - The system of a time step is positive definite for any dt > 0. Implicit Euler damps: a motion of angular frequency
     w loses about dt w^2 / 2 of its amplitude per unit of time.
   - dgfem_body_solve_static repeats linear solves with new rotations. It stops with DGFEM_ERROR_NOT_CONVERGED for
     loads that turn the tip of a beam by more than some 80 degrees: use load steps, or damped time steps.
   - With warping, linear momentum is kept but for round-off, angular momentum only nearly.
   - Counts and indices are int. Memory grows with the number of elements, that of the Cholesky factor faster;
     DGFEM_SOLVER_SWEEPS and _PCG need no factor.
   - In float, tolerances are as documented at each function; prefer double for degree 2 and 3 and for static solves.


   LICENCE

   MIT; the text stands at the end of this file. */

/* @contents */

#ifndef DGFEM_H
#define DGFEM_H
#include "dgfem/api.h"
#endif /* DGFEM_H */

#if defined(DGFEM_IMPLEMENTATION) && !defined(DGFEM_IMPLEMENTED)
#define DGFEM_IMPLEMENTED
#include "dgfem/base.c"
#include "dgfem/linalg.c"
#include "dgfem/planar.c"
#include "dgfem/moments.c"
#include "dgfem/polyhedron.c"
#include "dgfem/mesh.c"
#include "dgfem/corners.c"
#include "dgfem/mesh_build.c"
#include "dgfem/mesh_check.c"
#include "dgfem/mesh_merge.c"
#include "dgfem/parts.c"
#include "dgfem/join.c"
#include "dgfem/split_face.c"
#include "dgfem/split.c"
#include "dgfem/slice.c"
#include "dgfem/basis.c"
#include "dgfem/forms.c"
#include "dgfem/panel.c"
#include "dgfem/sparse.c"
#include "dgfem/ordering.c"
#include "dgfem/symbolic.c"
#include "dgfem/cholesky.c"
#include "dgfem/pcg.c"
#include "dgfem/ssor.c"
#include "dgfem/locate.c"
#include "dgfem/embed.c"
#include "dgfem/embed_view.c"
#include "dgfem/embed_points.c"
#include "dgfem/contact.c"
#include "dgfem/warp.c"
#include "dgfem/step_solver.c"
#include "dgfem/body.c"
#include "dgfem/load.c"
#include "dgfem/solve.c"
#include "dgfem/stability.c"
#include "dgfem/query.c"
#include "dgfem/pieces.c"
#include "dgfem/edit.c"
#include "dgfem/renew.c"
#include "dgfem/degree.c"
#include "dgfem/refine.c"
#include "dgfem/fracture.c"
#include "dgfem/blade.c"
#include "dgfem/skin.c"
#include "dgfem/skin_split.c"
#include "dgfem/skin_layer.c"
#include "dgfem/skin_cap.c"
#include "dgfem/skin_cut.c"
#include "dgfem/surface.c"
#include "dgfem/cut.c"
#endif /* DGFEM_IMPLEMENTATION */

/* Copyright (c) the dgfem authors

   Permission is hereby granted, free of charge, to any person obtaining a copy of this software and associated
   documentation files (the "Software"), to deal in the Software without restriction, including without limitation the
   rights to use, copy, modify, merge, publish, distribute, sublicense, and/or sell copies of the Software, and to permit
   persons to whom the Software is furnished to do so, subject to the following conditions:

   The above copyright notice and this permission notice shall be included in all copies or substantial portions of the
   Software.

   THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR IMPLIED, INCLUDING BUT NOT LIMITED TO THE
   WARRANTIES OF MERCHANTABILITY, FITNESS FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT. IN NO EVENT SHALL THE AUTHORS OR
   COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR
   OTHERWISE, ARISING FROM, OUT OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE SOFTWARE. */
