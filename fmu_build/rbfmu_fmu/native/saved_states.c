/* Saved states of an instance, and the bytes that they are written to and read from. */

#include <math.h>
#include <string.h>

#include "instance.h"

typedef struct {
    char guid[48];
    uint64_t checksum;
    State state;
} Serialized;

/* The link to a saved state of this instance, or null. */
static Saved **link_to(Instance *m, void *state) {
    Saved **link = &m->saved;
    while (*link && *link != state) link = &(*link)->next;
    return *link ? link : NULL;
}

static Saved *new_saved(Instance *m, const char *call) {
    Saved *saved = allocate(&m->host, sizeof *saved);
    if (!saved) {
        refuse(m, call, "no memory");
        return NULL;
    }
    saved->next = m->saved;
    return m->saved = saved;
}

static Saved *saved_of(Instance *m, const char *call, void *state) {
    Saved **link = m ? link_to(m, state) : NULL;
    if (!link) refuse(m, call, "this is no saved state of this instance");
    return link ? *link : NULL;
}

Status save_state(Instance *m, const char *call, void **state) {
    Saved *saved;
    if (!given(m, call, 1, state, state)) return CALL_ERROR;
    saved = *state ? saved_of(m, call, *state) : new_saved(m, call);
    if (!saved) return CALL_ERROR;
    saved->state = m->now;
    *state = saved;
    return CALL_OK;
}

Status restore_state(Instance *m, const char *call, void *state) {
    Saved *saved = saved_of(m, call, state);
    if (!saved) return CALL_ERROR;
    m->now = saved->state;
    return CALL_OK;
}

Status free_state(Instance *m, const char *call, void **state) {
    Saved **link, *next;
    if (!m) return CALL_ERROR;
    if (!state || !*state) return CALL_OK;
    if (!saved_of(m, call, *state)) return CALL_ERROR;
    link = link_to(m, *state);
    next = (*link)->next;
    release(&m->host, *link);
    *link = next;
    *state = NULL;
    return CALL_OK;
}

static uint64_t checksum(const State *state) { /* FNV-1a */
    const unsigned char *bytes = (const unsigned char *)state;
    uint64_t hash = 14695981039346656037u;
    for (size_t i = 0; i < sizeof *state; i++) hash = (hash ^ bytes[i]) * 1099511628211u;
    return hash;
}

static int is_valid(const Serialized *s) {
    static const char guid[sizeof s->guid] = GUID; /* with the zeros behind it */
    const State *state = &s->state;
    if (memcmp(s->guid, guid, sizeof guid) || s->checksum != checksum(state)) return 0;
    if (state->phase < 0 || state->phase >= PHASES) return 0;
    for (int r = 0; r < FIRST_OUTPUT; r++)
        if (!isfinite(state->z[OFFSETS[r]])) return 0;
    return isfinite(state->time) && !isnan(state->stop) && state->status >= STEP_OK && state->status <= PAST_STOP;
}

Status state_size(Instance *m, const char *call, void *state, size_t *size) {
    if (!given(m, call, 1, size, size) || !saved_of(m, call, state)) return CALL_ERROR;
    *size = sizeof(Serialized);
    return CALL_OK;
}

Status serialize_state(Instance *m, const char *call, void *state, void *bytes, size_t size) {
    Saved *saved = saved_of(m, call, state);
    Serialized s = {.guid = GUID};
    if (!saved || !given(m, call, 1, bytes, bytes)) return CALL_ERROR;
    if (size < sizeof s) return refuse(m, call, "%zu bytes: expected room for %zu", size, sizeof s);
    s.state = saved->state;
    s.checksum = checksum(&s.state);
    memcpy(bytes, &s, sizeof s);
    return CALL_OK;
}

Status deserialize_state(Instance *m, const char *call, const void *bytes, size_t size, void **state) {
    Saved **link, *saved;
    Serialized s;
    if (!given(m, call, 1, bytes, state)) return CALL_ERROR;
    if (size == sizeof s) memcpy(&s, bytes, sizeof s);
    if (size != sizeof s || !is_valid(&s)) return refuse(m, call, "these %zu bytes are no state of this FMU", size);
    link = link_to(m, *state);
    saved = link ? *link : new_saved(m, call);
    if (!saved) return CALL_ERROR;
    saved->state = s.state;
    *state = saved;
    return CALL_OK;
}
