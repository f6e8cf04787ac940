/*
 * A decision table of squeezes, and the function that executes it. Made by plan-export from the table with the
 * SHA-256 {{ digest }}
 * ({{ tool }}; gripper {{ model }}). Do not edit: export it again.
 *
 * C99, of which only stdint.h is used: no library, no allocation, no floating point, no state.
 * Lengths in um, angles in urad counter-clockwise, forces in mN, speeds in um/s (of the opening), shares in ppm.
 *
 * A part begins at node 0. Place the hand as {{ prefix }}_nodes[node] says, close, wait until the jaws rest, and
 * give node, width in um and object flag to {{ prefix }}_decide. Whatever comes of it except a
 * fault, bring the hand to the release, which is where it stands or where what it holds is dragged, and open.
 *
 * Widths are those that the gripper reads from closed, 0 um, to open, {{ gripper.opening_um }} um, or a calibration of them.
{% if counts %}
 * A gripper that counts, {{ counts[0] }} open and {{ counts[1] }} closed, reads the width
 * {{ gripper.opening_um }} * ({{ counts[1] }} - count) / {{ gripper.steps }} um, rounded, from 0 to {{ gripper.opening_um }}.
{% endif %}
 */
#if defined {{ prefix | upper }}_TABLE_H && !defined {{ prefix | upper }}_TABLE_{{ digest[:32] }}
#error "another table has the prefix {{ prefix }}: export one of the two with plan-export --prefix NAME"
#endif
#ifndef {{ prefix | upper }}_TABLE_H
#define {{ prefix | upper }}_TABLE_H
#define {{ prefix | upper }}_TABLE_{{ digest[:32] }}

#include <stdint.h>

#define {{ prefix | upper }}_TABLE_SHA256 "{{ digest }}"
#define {{ prefix | upper }}_NODES {{ nodes | length }}
#define {{ prefix | upper }}_RUNS {{ runs | length }}
#define {{ prefix | upper }}_LEAVES {{ leaves | length }}
#define {{ prefix | upper }}_ALTERNATIVES {{ alternatives | length }}

/* What no motion may exceed, and the heights of the finger tips. */
#define {{ prefix | upper }}_MAX_DEPTH {{ limits.max_depth }}
#define {{ prefix | upper }}_MAX_FORCE_MN {{ limits.max_force_mn }}
#define {{ prefix | upper }}_MAX_SPEED_UM_S {{ limits.max_speed_um_s }}
#define {{ prefix | upper }}_AREA_X_MIN_UM ({{ limits.work_area_um[0] }})
#define {{ prefix | upper }}_AREA_Y_MIN_UM ({{ limits.work_area_um[1] }})
#define {{ prefix | upper }}_AREA_X_MAX_UM ({{ limits.work_area_um[2] }})
#define {{ prefix | upper }}_AREA_Y_MAX_UM ({{ limits.work_area_um[3] }})
#define {{ prefix | upper }}_RETREAT_HEIGHT_UM ({{ limits.retreat_height_um }})
#define {{ prefix | upper }}_SQUEEZE_HEIGHT_UM ({{ limits.squeeze_height_um }})
#define {{ prefix | upper }}_ARM_SPEED_UM_S {{ limits.arm_speed_um_s }}

/* One squeeze: the hand's centre and angle in the world, the opening before it, how it closes. */
typedef struct {
    int32_t x_um, y_um, angle_urad;
    int32_t opening_um, speed_um_s, force_mn;
    int32_t release_x_um, release_y_um; /* where what is held is dragged, at the same angle */
    int32_t first_run, runs;            /* its readings in {{ prefix }}_runs */
} {{ prefix }}_node;

/* Widths of one meaning. A reading that is in no run of its node is rejected. */
typedef struct {
    int32_t first_um, last_um; /* widths, both included */
    int16_t target;            /* >= 0: the next node; < 0: leaf -1 - target */
    uint8_t object_flag;       /* 2: an object was felt; 3: none was */
    uint8_t held;              /* 1: the jaws hold the part */
} {{ prefix }}_run;

/* Where the part lies. */
typedef struct {
    int32_t x_um, y_um, theta_urad;
    int32_t success_ppm;  /* share of simulated parts that ended here and met the goal; -1: none ended here */
    int32_t error_p95_um; /* 95th percentile of their error */
    int32_t resolved;     /* 0: the table does not trust this pose */
    int32_t first_alternative, alternatives; /* further poses, in {{ prefix }}_alternatives */
} {{ prefix }}_leaf;

typedef struct {
    int32_t x_um, y_um, theta_urad;
} {{ prefix }}_pose;

enum {
    {{ prefix | upper }}_NODE = 0,       /* index is the node to squeeze at next */
    {{ prefix | upper }}_LEAF = 1,       /* index is the leaf that says where the part lies */
    {{ prefix | upper }}_UNRESOLVED = 2, /* index is a leaf that the table does not trust */
    {{ prefix | upper }}_REJECT = 3,     /* no outcome of this squeeze reads so */
    {{ prefix | upper }}_FAULT = 4       /* no such node, or an object flag other than 2 and 3: move nothing */
};

typedef struct {
    int32_t outcome;
    int32_t index;                      /* of a node or leaf; -1 for a reject or a fault */
    int32_t release_x_um, release_y_um; /* where the hand opens; no meaning after a fault */
} {{ prefix }}_decision;

static const {{ prefix }}_node {{ prefix }}_nodes[{{ prefix | upper }}_NODES] = {
{% for row in nodes %}
    { {{- row | numbers -}} },
{% endfor %}
};

static const {{ prefix }}_run {{ prefix }}_runs[{{ prefix | upper }}_RUNS] = {
{% for row in runs %}
    { {{- row | numbers -}} },
{% endfor %}
};

static const {{ prefix }}_leaf {{ prefix }}_leaves[{{ prefix | upper }}_LEAVES] = {
{% for row in leaves %}
    { {{- row | numbers -}} },
{% endfor %}
};

/* C99 has no empty array: without alternatives, one that no leaf names. */
static const {{ prefix }}_pose {{ prefix }}_alternatives[{{ prefix | upper }}_ALTERNATIVES + 1] = {
{% for row in alternatives %}
    { {{- row | numbers -}} },
{% endfor %}
    {0, 0, 0},
};

/* What a settled reading means at a node. Any arguments are allowed: what is none ends in a fault or reject. */
static inline {{ prefix }}_decision {{ prefix }}_decide(int32_t node, int32_t width_um, int32_t object_flag)
{
    {{ prefix }}_decision decision = {{ "{" }}{{ prefix | upper }}_FAULT, -1, 0, 0};
    const {{ prefix }}_node *at;
    int32_t k;

    if (node < 0 || node >= {{ prefix | upper }}_NODES || (object_flag != 2 && object_flag != 3)) {
        return decision;
    }
    at = &{{ prefix }}_nodes[node];
    decision.outcome = {{ prefix | upper }}_REJECT;
    decision.release_x_um = at->x_um;
    decision.release_y_um = at->y_um;
    for (k = 0; k < at->runs; k++) {
        const {{ prefix }}_run *run = &{{ prefix }}_runs[at->first_run + k];

        if (run->object_flag != object_flag || width_um < run->first_um || width_um > run->last_um) {
            continue;
        }
        if (run->held) {
            decision.release_x_um = at->release_x_um;
            decision.release_y_um = at->release_y_um;
        }
        if (run->target >= 0) {
            decision.outcome = {{ prefix | upper }}_NODE;
            decision.index = run->target;
        } else {
            decision.index = -1 - run->target;
            decision.outcome =
                {{ prefix }}_leaves[decision.index].resolved ? {{ prefix | upper }}_LEAF : {{ prefix | upper }}_UNRESOLVED;
        }
        break;
    }
    return decision;
}

#endif
