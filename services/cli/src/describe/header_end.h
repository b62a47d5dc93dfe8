
/* Joins the run that has started this program, or ends the program with the reason. */
static inline struct armplane_process *armplane_begin(void) {
    char why[1024];
    struct armplane_process *process = armplane_process_join(ARMPLANE_PROCESS_ABI_VERSION, NULL, NULL, why, sizeof why);
    if (!process) {
        fprintf(stderr, "armplane: %s\n", why);
        exit(1);
    }
    return process;
}

#endif
