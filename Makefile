# `make help` lists the targets; `make` alone builds the examples.
# A C compiler, GNU make and a POSIX shell suffice for the library and its examples; `make test` and `make demo` install
# what else they need (see .ci/need).

.DEFAULT_GOAL := examples
ifeq ($(origin CC),default)
CC := gcc
endif
JOBS ?= 2
MAKEFLAGS += --no-builtin-rules
export CC JOBS

PRODUCTS := $(wildcard dgfem.h dgfem_shell.h dgfem_mvc.h)
TESTS := $(patsubst tests/%.c,%,$(wildcard tests/test_*.c))
EXAMPLES := $(patsubst examples/%.c,build/examples/%,$(wildcard examples/*.c))
BENCHES := $(patsubst bench/%.c,build/bench/%,$(wildcard bench/bench_*.c)) build/bench/bench_step_float
COMMON := $(wildcard examples/common/*.h examples/common/*.c)
# What all examples are linked with, compiled once.
OBJECTS := $(PRODUCTS:%.h=build/%.o) $(patsubst examples/common/%.c,build/common/%.o,$(filter %.c,$(COMMON)))

WARNINGS := -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wdouble-promotion -Werror
POSIX := -D_POSIX_C_SOURCE=200809L
INCLUDES := -I. -Iexamples/common -Itests
CFLAGS ?= -O3
# Optimised more, or with full debug information, the library would take several times as long to compile; without
# optimization gcc would keep all static functions.
TEST_FLAGS := -Og -g1
SANITIZE := -fsanitize=address,undefined -fno-sanitize-recover=all --param asan-instrumentation-with-call-threshold=0
BENCH_FLAGS := -O3 -march=native

.PHONY: paper paper-quick help headers demo test check-long bench examples pictures format clean build-tests build-long
help: ## lists the targets
	@sed -n 's/^\([a-z-]*\):.*## /  make \1\t/p' $(firstword $(MAKEFILE_LIST)) | expand -t 20

# ---- headers --------------------------------------------------------------------------------------------------------

# Degree of the generated moments.
MOMENTS := 6
export MOMENTS

GENERATORS := build/gen/pack build/gen/moments_gen

# Programs are built beside their place and moved there, so that none is ever seen half written.
build/gen/%: src/gen/%.c
	@mkdir -p $(@D)
	@$(CC) -std=c99 $(POSIX) -O1 $(WARNINGS) -o $@.$$$$ $< && mv $@.$$$$ $@

# DRAFTS=1 tolerates parts that no umbrella lists yet.
headers: $(GENERATORS) ## rewrites the product headers from src/
	@build/gen/moments_gen $(MOMENTS) > build/gen/moments.$$$$ && \
	if cmp -s build/gen/moments.$$$$ src/dgfem/moments_generated.c; then rm build/gen/moments.$$$$; \
	else mv build/gen/moments.$$$$ src/dgfem/moments_generated.c; fi
	@build/gen/pack $(if $(DRAFTS),--drafts) src .

# ---- examples and demo ----------------------------------------------------------------------------------------------

examples: $(EXAMPLES) ## builds the examples into build/examples/

# Each example is a whole program with the library in it. Here the library is compiled once for all of them: with
# DGFEM_IMPLEMENTED defined, DGFEM_IMPLEMENTATION adds nothing.
build/dgfem_%.o: NOT_HERE := -DDGFEM_IMPLEMENTED
build/%.o: %.h dgfem.h
	@mkdir -p $(@D)
	$(CC) -std=c99 $(POSIX) $(CFLAGS) $(WARNINGS) -DDGFEM_IMPLEMENTATION $(NOT_HERE) -x c -c -o $@.$$$$ $< && \
	mv $@.$$$$ $@

build/common/%.o: examples/common/%.c $(PRODUCTS) $(COMMON)
	@mkdir -p $(@D)
	$(CC) -std=c99 $(POSIX) $(CFLAGS) $(WARNINGS) $(INCLUDES) -c -o $@.$$$$ $< && mv $@.$$$$ $@

build/examples/%: examples/%.c $(PRODUCTS) $(COMMON) $(OBJECTS)
	@mkdir -p $(@D)
	$(CC) -std=c99 $(POSIX) $(CFLAGS) $(WARNINGS) $(INCLUDES) -DDGFEM_IMPLEMENTED -DDGFEM_SHELL_IMPLEMENTED \
	-DDGFEM_MVC_IMPLEMENTED -o $@.$$$$ $< $(OBJECTS) -lm && mv $@.$$$$ $@

# The bunny comes as a JavaScript module from npm; without it the demo uses a shape of its own.
build/bunny.obj:
	@mkdir -p build/npm
	@cd build/npm && if npm pack --fetch-retries=1 --fetch-timeout=20000 bunny@1.0.1 > log 2>&1 && \
	tar xzf bunny-1.0.1.tgz && awk -f ../../examples/common/bunny.awk package/index.js > bunny.$$$$; \
	then mv bunny.$$$$ ../bunny.obj; \
	else head -n 3 log; echo "make: npm's package \"bunny\" cannot be had: a built-in shape takes its place"; fi

# Its tetrahedra, where TetGen is installed; mvc_bunny has a lattice of its own.
build/bunny.1.ele: build/bunny.obj
	@if [ -s $< ] && command -v tetgen > /dev/null; then \
	awk -f examples/common/off.awk $< $< > build/bunny.off && tetgen -pYq1.6Q build/bunny.off > build/tetgen.log; fi

demo: ## drops a soft bunny down a slope: frames, a summary and a picture in build/demo/
	@.ci/need --optional npm f3d xvfb xauth
	@$(MAKE) --no-print-directory build/bunny.obj build/examples/bunny
	@mkdir -p build/demo
	build/examples/bunny $$(test -e build/bunny.obj && echo --model build/bunny.obj) --out build/demo
	@sh examples/pictures.sh demo

pictures: $(EXAMPLES) ## renders examples/pictures/*.png from the examples' output
	@.ci/need npm f3d xvfb xauth
	@.ci/need --optional tetgen
	@$(MAKE) --no-print-directory build/bunny.obj build/bunny.1.ele
	@sh examples/pictures.sh all

# ---- tests ----------------------------------------------------------------------------------------------------------

# `make test` runs every test in double as it is, and in float under the sanitizers without their dearest checks;
# `make check-long` adds a build in double with all of them.
TEST_KINDS := double float sanitize
TEST_PROGRAMS := $(TESTS:%=build/tests/double/%) $(TESTS:%=build/tests/float/%)
LONG_PROGRAMS := $(TEST_PROGRAMS) $(TESTS:%=build/tests/sanitize/%)
CHECKS := library readme matrix:gcc matrix:g++ matrix:clang matrix:clang++ bench failing examples headers packer
TEST_SOURCES := $(PRODUCTS) $(COMMON) $(wildcard tests/*.h)

# A test that calls private functions or looks into opaque types (then it defines DGFEM_STATIC) has the library, as far
# as it is used, in its own translation unit. The others are linked with one object of each kind.
LINKED_TESTS := $(patsubst tests/%.c,%,$(shell grep -L 'dgfemi_\|define DGFEM_STATIC' tests/test_*.c))

build/tests/double/%: KIND := -DDGFEM_REAL=double
build/tests/float/%: KIND := -DDGFEM_REAL=float $(SANITIZE) -fno-sanitize=null,object-size,pointer-overflow,alignment
build/tests/sanitize/%: KIND := -DDGFEM_REAL=double $(SANITIZE)

define test_rule
build/tests/$(1)/dgfem.o: dgfem.h
	@mkdir -p $$(@D)
	@echo "building $$@"
	@$(CC) -std=c99 $(POSIX) $(TEST_FLAGS) $$(KIND) $(WARNINGS) -DDGFEM_IMPLEMENTATION -x c -c -o $$@.$$$$$$$$ $$< && \
	mv $$@.$$$$$$$$ $$@

$(LINKED_TESTS:%=build/tests/$(1)/%): build/tests/$(1)/dgfem.o
$(LINKED_TESTS:%=build/tests/$(1)/%): LIBRARY := -DDGFEM_IMPLEMENTED build/tests/$(1)/dgfem.o

build/tests/$(1)/%: LIBRARY := -DDGFEM_STATIC
build/tests/$(1)/%: tests/%.c $(TEST_SOURCES)
	@mkdir -p $$(@D)
	@echo "building $$@"
	@$(CC) -std=c99 $(POSIX) $(TEST_FLAGS) $$(KIND) $(WARNINGS) $(INCLUDES) -o $$@.$$$$$$$$ $$< $$(LIBRARY) \
	-Wl,--as-needed -lcmocka -lgmp -lm && mv $$@.$$$$$$$$ $$@
endef
$(foreach kind,$(TEST_KINDS),$(eval $(call test_rule,$(kind))))

build-tests: $(TEST_PROGRAMS)
build-long: $(LONG_PROGRAMS)

test: $(GENERATORS) ## runs all tests; ends with "N passed, N failed"
	@.ci/need libcmocka-dev libgmp-dev
	@.ci/need --optional g++
	@sh tests/checks.sh headers > /dev/null || { sh tests/run.sh "sh tests/checks.sh headers"; exit 1; }
	@$(MAKE) --no-print-directory -k -j$(JOBS) examples build-tests || echo "make: something does not compile"
	@sh tests/run.sh $(foreach check,$(CHECKS),"sh tests/checks.sh $(subst :, ,$(check))") $(TEST_PROGRAMS)

# Tests read DGFEM_LONG.
check-long: ## the long campaigns of the tests, with all sanitizers, and all tests under valgrind
	@.ci/need libcmocka-dev libgmp-dev valgrind
	@$(MAKE) --no-print-directory -j$(JOBS) build-long
	@DGFEM_LONG=1 SECONDS_EACH=7200 sh tests/run.sh $(LONG_PROGRAMS)
	@RUNNER="valgrind -q --error-exitcode=99 --leak-check=full" SECONDS_EACH=7200 \
	sh tests/run.sh $(TESTS:%=build/tests/double/%)

# ---- benchmarks -----------------------------------------------------------------------------------------------------

# The solvers' peers, where they are installed. Eigen needs a C++ compiler.
CHOLMOD = $(shell echo 'int main(void) { return 0; }' | \
	$(CC) -include suitesparse/cholmod.h -o build/bench/probe -x c - -lcholmod -lopenblas 2> /dev/null && \
	rm build/bench/probe && echo -DHAVE_CHOLMOD -lcholmod -lopenblas)
EIGEN = $(shell test -e build/bench/eigen.o && echo -DHAVE_EIGEN build/bench/eigen.o -lstdc++)

build/bench/bench_solver: PEERS = $(CHOLMOD)
build/bench/%: bench/%.c $(PRODUCTS) $(COMMON) $(wildcard bench/*.h)
	@mkdir -p $(@D)
	@$(CC) -std=c99 $(POSIX) $(BENCH_FLAGS) $(WARNINGS) $(INCLUDES) -Ibench -o $@.$$$$ $< \
	$(filter examples/common/%.c,$^) $(PEERS) -lm && mv $@.$$$$ $@

build/bench/eigen.o: bench/eigen.cpp
	@mkdir -p $(@D)
	@$(CXX) $(BENCH_FLAGS) -DNDEBUG -isystem /usr/include/eigen3 -c -o $@ $< 2> /dev/null || rm -f $@

# Programs that call only public functions share one object of each precision.
BENCH_LINK = $(CC) -std=c99 $(POSIX) $(BENCH_FLAGS) $(WARNINGS) $(INCLUDES) -DDGFEM_IMPLEMENTED \
	-DDGFEM_MVC_IMPLEMENTED -o $@.$$$$ $(filter-out %/eigen.o,$(filter %.c %.o,$^)) $(PEERS) -pthread -lm && mv $@.$$$$ $@
build/bench/float.o build/bench/bench_step_float: BENCH_FLAGS += -DDGFEM_REAL=float
build/bench/bench_step build/bench/bench_step_float: PEERS = $(CHOLMOD) $(EIGEN)

build/bench/mvc.o: BENCH_FLAGS += -DDGFEM_IMPLEMENTED
build/bench/mvc.o: dgfem_mvc.h dgfem.h
build/bench/double.o build/bench/float.o: dgfem.h
build/bench/mvc.o build/bench/double.o build/bench/float.o:
	@mkdir -p $(@D)
	@$(CC) -std=c99 $(POSIX) $(BENCH_FLAGS) $(WARNINGS) -DDGFEM_IMPLEMENTATION -x c -c -o $@.$$$$ $< && \
	mv $@.$$$$ $@

build/bench/reference.o: bench/reference.c $(wildcard bench/*.h) dgfem.h
	@mkdir -p $(@D)
	@$(CC) -std=c99 $(POSIX) -O3 -march=native $(WARNINGS) $(INCLUDES) -c -o $@.$$$$ $< && mv $@.$$$$ $@

build/bench/bench_step: bench/bench_step.c build/bench/double.o build/bench/reference.o build/bench/eigen.o
build/bench/bench_step_float: bench/bench_step.c build/bench/float.o build/bench/reference.o build/bench/eigen.o
build/bench/bench_size: bench/bench_size.c build/bench/double.o
build/bench/bench_error: bench/bench_error.c build/bench/double.o build/bench/mvc.o examples/paper/paper.h
build/bench/bench_step build/bench/bench_step_float build/bench/bench_size build/bench/bench_error: $(COMMON) \
	$(wildcard bench/*.h)
	@$(BENCH_LINK)

bench: ## builds and runs the benchmarks
	@.ci/need --optional npm libsuitesparse-dev libopenblas-dev libeigen3-dev g++ gnuplot-nox
	@$(MAKE) --no-print-directory build/bunny.obj $(BENCHES)
	@for program in $(BENCHES); do echo "-- $$program"; \
	OMP_THREAD_LIMIT=1 OPENBLAS_NUM_THREADS=1 $$program || exit 1; done
	@if command -v gnuplot > /dev/null; then gnuplot -e "at='build/bench'" bench/plots.gp; \
	else echo "no plots: gnuplot is not installed"; fi

# ---- the paper's experiments ----------------------------------------------------------------------------------------

PAPER := $(patsubst examples/paper/%.c,build/paper/%,$(filter-out %/library.c,$(wildcard examples/paper/*.c)))

build/paper/library.o: examples/paper/library.c dgfem.h
	@mkdir -p $(@D)
	$(CC) -std=c99 $(POSIX) $(CFLAGS) $(WARNINGS) $(INCLUDES) -c -o $@.$$$$ $< && mv $@.$$$$ $@

build/paper/%: examples/paper/%.c build/paper/library.o $(wildcard examples/paper/*.h) examples/common/program.h
	$(CC) -std=c99 $(POSIX) $(CFLAGS) $(WARNINGS) $(INCLUDES) -o $@.$$$$ $< build/paper/library.o -lm && mv $@.$$$$ $@

paper: $(PAPER) ## repeats the paper's experiments: examples/paper/RESULTS.md and its plots; takes minutes
	@command -v gnuplot > /dev/null || .ci/need --optional gnuplot-nox
	@sh examples/paper/results.sh

paper-quick: $(PAPER) ## the same without the finest meshes, into build/paper/
	@sh examples/paper/results.sh --quick

# ---- the rest -------------------------------------------------------------------------------------------------------

format: ## clang-format on everything written by hand
	@.ci/need clang-format
	clang-format -i $(filter-out %_generated.c,$(wildcard src/*/*.c src/*/*.h tests/*.c tests/*.h examples/*.c \
	examples/common/*.[ch] bench/*.c bench/*.h))

clean: ## removes build/
	rm -rf build
