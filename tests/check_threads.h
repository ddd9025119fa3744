/* A host with several threads: its parallel_for gives each range to whichever thread comes first, so that every run
   takes the ranges in another order. Include it after check.h. */
#ifndef CHECK_THREADS_H
#define CHECK_THREADS_H

#include <pthread.h>

typedef struct check_workers {
    int count;  /* threads, 1 or more */
    long loops; /* calls of parallel_for */
} check_workers;

typedef struct check_loop {
    pthread_mutex_t mutex;
    int next, count, grain;
    dgfem_range_fn fn;
    void *context;
} check_loop;

static inline void *check_worker(void *user) {
    check_loop *loop = (check_loop *)user;
    for (;;) {
        int first, last;
        pthread_mutex_lock(&loop->mutex);
        first = loop->next;
        last = loop->count - first < loop->grain ? loop->count : first + loop->grain;
        loop->next = last;
        pthread_mutex_unlock(&loop->mutex);
        if (first >= last) return NULL;
        loop->fn(loop->context, first, last);
    }
}

static inline void check_parallel_for(void *user, int count, int grain, dgfem_range_fn fn, void *context) {
    enum { MOST = 16 };
    check_workers *workers = (check_workers *)user;
    pthread_t threads[MOST];
    check_loop loop;
    int started = 0;
    memset(&loop, 0, sizeof loop);
    assert_true(workers->count >= 1 && workers->count <= MOST && grain >= 1);
    assert_int_equal(pthread_mutex_init(&loop.mutex, NULL), 0);
    loop.count = count, loop.grain = grain, loop.fn = fn, loop.context = context;
    workers->loops++;
    for (; started < workers->count - 1; started++)
        assert_int_equal(pthread_create(&threads[started], NULL, check_worker, &loop), 0);
    check_worker(&loop);
    while (started > 0) pthread_join(threads[--started], NULL);
    pthread_mutex_destroy(&loop.mutex);
}

/* One thread: ranges of uneven size, the last one first. user: long, counts the calls. */
static inline void check_ragged_parallel_for(void *user, int count, int grain, dgfem_range_fn fn, void *context) {
    int last = count, size = 1;
    (void)grain;
    ++*(long *)user;
    while (last > 0) {
        int first = last > size ? last - size : 0;
        fn(context, first, last);
        last = first, size = 3 * size % 64 + 1;
    }
}

#endif
