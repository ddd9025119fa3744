/* A host with several threads, for dgfem_hooks.parallel_for: workers that wait for ranges between calls. A call from
   inside a range runs there and then. */
#ifndef THREADS_H
#define THREADS_H

#include <pthread.h>

#include "bench.h"

enum { MAX_WORKERS = 64 };

typedef struct workers {
    int count; /* the caller's thread included */
    pthread_t threads[MAX_WORKERS];
    pthread_mutex_t mutex;
    pthread_cond_t start, done;
    int stop, busy, running; /* ranges in work */
    int next, last, grain;   /* of the loop */
    dgfem_range_fn fn;
    void *context;
} workers;

/* Holds the mutex before and after. */
static inline void take_ranges(workers *w) {
    while (w->next < w->last) {
        int first = w->next, end = w->last - first < w->grain ? w->last : first + w->grain;
        w->next = end;
        w->running++;
        pthread_mutex_unlock(&w->mutex);
        w->fn(w->context, first, end);
        pthread_mutex_lock(&w->mutex);
        w->running--;
    }
    if (w->running == 0) pthread_cond_signal(&w->done);
}

static inline void *worker_main(void *user) {
    workers *w = (workers *)user;
    pthread_mutex_lock(&w->mutex);
    while (!w->stop) {
        if (w->next < w->last) take_ranges(w);
        else pthread_cond_wait(&w->start, &w->mutex);
    }
    pthread_mutex_unlock(&w->mutex);
    return NULL;
}

static inline void workers_parallel_for(void *user, int count, int grain, dgfem_range_fn fn, void *context) {
    workers *w = (workers *)user;
    pthread_mutex_lock(&w->mutex);
    int nested = w->busy;
    if (!nested) {
        w->busy = 1;
        w->next = 0, w->last = count, w->grain = grain;
        w->fn = fn, w->context = context;
        pthread_cond_broadcast(&w->start);
        take_ranges(w);
        while (w->running > 0) pthread_cond_wait(&w->done, &w->mutex);
        w->busy = 0;
    }
    pthread_mutex_unlock(&w->mutex);
    if (nested) fn(context, 0, count);
}

static inline void workers_start(workers *w, int count) {
    memset(w, 0, sizeof *w);
    w->count = count;
    expect(count >= 1 && count <= MAX_WORKERS, "number of threads");
    expect(!pthread_mutex_init(&w->mutex, NULL) && !pthread_cond_init(&w->start, NULL) &&
               !pthread_cond_init(&w->done, NULL),
           "pthread");
    for (int i = 1; i < count; i++) expect(!pthread_create(&w->threads[i], NULL, worker_main, w), "pthread_create");
}

static inline void workers_stop(workers *w) {
    pthread_mutex_lock(&w->mutex);
    w->stop = 1;
    pthread_cond_broadcast(&w->start);
    pthread_mutex_unlock(&w->mutex);
    for (int i = 1; i < w->count; i++) pthread_join(w->threads[i], NULL);
}

#endif
