/*
 * A decision table of squeezes, and the function that executes it. Made by plan-export from the table with the
 * SHA-256 {{ digest }}
 * ({{ tool }}; gripper {{ model }}). Do not edit: export it again.
 *
 * C99, of which only stdint.h is used: no library, no allocation, no floating point, no state.
 * Lengths in um, angles in urad counter-clockwise, forces in mN, speeds in um/s (of the opening), shares in ppm.
 *
 * A part begins at node 0. Place the hand as squeezetree_nodes[node] says, close, wait until the jaws rest, and
 * give node, encoder count and object flag (gOBJ) to squeezetree_decide. Whatever comes of it except a
 * fault, bring the hand to the release, which is where it stands or where what it holds is dragged, and open.
 *
 * Counts mean widths by the straight line from count {{ gripper.count_open }} (open, {{ gripper.opening_um }} um)
 * to count {{ gripper.count_closed }} (closed).
 */
#ifndef SQUEEZETREE_TABLE_H
#define SQUEEZETREE_TABLE_H

#include <stdint.h>

#define SQUEEZETREE_TABLE_SHA256 "{{ digest }}"
#define SQUEEZETREE_NODES {{ nodes | length }}
#define SQUEEZETREE_RUNS {{ runs | length }}
#define SQUEEZETREE_LEAVES {{ leaves | length }}
#define SQUEEZETREE_ALTERNATIVES {{ alternatives | length }}

/* What no motion may exceed, and the heights of the finger tips. */
#define SQUEEZETREE_MAX_DEPTH {{ limits.max_depth }}
#define SQUEEZETREE_MAX_FORCE_MN {{ limits.max_force_mn }}
#define SQUEEZETREE_MAX_SPEED_UM_S {{ limits.max_speed_um_s }}
#define SQUEEZETREE_AREA_X_MIN_UM ({{ limits.work_area_um[0] }})
#define SQUEEZETREE_AREA_Y_MIN_UM ({{ limits.work_area_um[1] }})
#define SQUEEZETREE_AREA_X_MAX_UM ({{ limits.work_area_um[2] }})
#define SQUEEZETREE_AREA_Y_MAX_UM ({{ limits.work_area_um[3] }})
#define SQUEEZETREE_RETREAT_HEIGHT_UM ({{ limits.retreat_height_um }})
#define SQUEEZETREE_SQUEEZE_HEIGHT_UM ({{ limits.squeeze_height_um }})
#define SQUEEZETREE_ARM_SPEED_UM_S {{ limits.arm_speed_um_s }}

/* One squeeze: the hand's centre and angle in the world, the opening before it, how it closes. */
typedef struct {
    int32_t x_um, y_um, angle_urad;
    int32_t opening_um, speed_um_s, force_mn;
    int32_t release_x_um, release_y_um; /* where what is held is dragged, at the same angle */
    int32_t first_run, runs;            /* its readings in squeezetree_runs */
} squeezetree_node;

/* Neighbouring counts of one meaning. A reading that is in no run of its node is rejected. */
typedef struct {
    uint8_t object_flag; /* 2: an object was felt; 3: none was */
    uint8_t first, last; /* counts, both included */
    uint8_t held;        /* 1: the jaws hold the part */
    int16_t target;      /* >= 0: the next node; < 0: leaf -1 - target */
} squeezetree_run;

/* Where the part lies. */
typedef struct {
    int32_t x_um, y_um, theta_urad;
    int32_t success_ppm;  /* share of simulated parts that ended here and met the goal; -1: none ended here */
    int32_t error_p95_um; /* 95th percentile of their error */
    int32_t resolved;     /* 0: the table does not trust this pose */
    int32_t first_alternative, alternatives; /* further poses, in squeezetree_alternatives */
} squeezetree_leaf;

typedef struct {
    int32_t x_um, y_um, theta_urad;
} squeezetree_pose;

enum {
    SQUEEZETREE_NODE = 0,       /* index is the node to squeeze at next */
    SQUEEZETREE_LEAF = 1,       /* index is the leaf that says where the part lies */
    SQUEEZETREE_UNRESOLVED = 2, /* index is a leaf that the table does not trust */
    SQUEEZETREE_REJECT = 3,     /* no outcome of this squeeze reads so */
    SQUEEZETREE_FAULT = 4       /* no such node, or an object flag other than 2 and 3: move nothing */
};

typedef struct {
    int32_t outcome;
    int32_t index;                      /* of a node or leaf; -1 for a reject or a fault */
    int32_t release_x_um, release_y_um; /* where the hand opens; no meaning after a fault */
} squeezetree_decision;

static const squeezetree_node squeezetree_nodes[SQUEEZETREE_NODES] = {
{% for row in nodes %}
    { {{- row | numbers -}} },
{% endfor %}
};

static const squeezetree_run squeezetree_runs[SQUEEZETREE_RUNS] = {
{% for row in runs %}
    { {{- row | numbers -}} },
{% endfor %}
};

static const squeezetree_leaf squeezetree_leaves[SQUEEZETREE_LEAVES] = {
{% for row in leaves %}
    { {{- row | numbers -}} },
{% endfor %}
};

/* C99 has no empty array: without alternatives, one that no leaf names. */
static const squeezetree_pose squeezetree_alternatives[SQUEEZETREE_ALTERNATIVES + 1] = {
{% for row in alternatives %}
    { {{- row | numbers -}} },
{% endfor %}
    {0, 0, 0},
};

/* What a settled reading means at a node. Any arguments are allowed: what is none ends in a fault or reject. */
static inline squeezetree_decision squeezetree_decide(int32_t node, int32_t count, int32_t object_flag)
{
    squeezetree_decision decision = {SQUEEZETREE_FAULT, -1, 0, 0};
    const squeezetree_node *at;
    int32_t k;

    if (node < 0 || node >= SQUEEZETREE_NODES || (object_flag != 2 && object_flag != 3)) {
        return decision;
    }
    at = &squeezetree_nodes[node];
    decision.outcome = SQUEEZETREE_REJECT;
    decision.release_x_um = at->x_um;
    decision.release_y_um = at->y_um;
    for (k = 0; k < at->runs; k++) {
        const squeezetree_run *run = &squeezetree_runs[at->first_run + k];

        if (run->object_flag != object_flag || count < run->first || count > run->last) {
            continue;
        }
        if (run->held) {
            decision.release_x_um = at->release_x_um;
            decision.release_y_um = at->release_y_um;
        }
        if (run->target >= 0) {
            decision.outcome = SQUEEZETREE_NODE;
            decision.index = run->target;
        } else {
            decision.index = -1 - run->target;
            decision.outcome =
                squeezetree_leaves[decision.index].resolved ? SQUEEZETREE_LEAF : SQUEEZETREE_UNRESOLVED;
        }
        break;
    }
    return decision;
}

#endif
