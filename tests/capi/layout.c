/* Structure sizes and offsets on a 64-bit machine, printed for comparison with the bindings. */

#include "check.h"

#if UINTPTR_MAX == UINT64_MAX
#define FIELD(type, field, wide, narrow) _Static_assert(offsetof(type, field) == (wide), #type "." #field)
#define SIZE(type, wide, narrow) _Static_assert(sizeof(type) == (wide), #type)
#elif !defined(__i386__) /* whose 64-bit numbers are aligned to 4 bytes */
#define FIELD(type, field, wide, narrow) _Static_assert(offsetof(type, field) == (narrow), #type "." #field)
#define SIZE(type, wide, narrow) _Static_assert(sizeof(type) == (narrow), #type)
#endif
#ifdef FIELD
#include "generated.h"
#endif

/* Structures of later versions, larger than this library knows, and structures smaller than any version. */
static void structures_grow(umo_model *model) {
    struct {
        umo_model_config known;
        uint64_t later[4];
    } config;
    OK(umo_model_config_init(&config.known, sizeof config));
    CHECK(config.known.struct_size == sizeof config && config.later[3] == 0);
    umo_model *again = NULL;
    FAILS(IO, umo_model_load(UMO_ABI_VERSION, "no such file", &config.known, &again));
    config.later[2] = 1;
    FAILS(STRUCT_SIZE, umo_model_load(UMO_ABI_VERSION, "no such file", &config.known, &again));
    FAILS(STRUCT_SIZE, umo_model_config_init(&config.known, sizeof config.known - 1));
    FAILS(STRUCT_SIZE, umo_model_config_init(&config.known, (size_t)-1));

    struct {
        umo_model_info known;
        uint64_t later[4];
    } info;
    memset(&info, 0x55, sizeof info);
    info.known.struct_size = sizeof info;
    OK(umo_model_get_info(model, &info.known));
    CHECK(info.known.struct_size == sizeof info && info.known.joints == UMO_JOINT_COUNT);
    CHECK(info.later[0] == 0x5555555555555555u);
    info.known.struct_size = sizeof info.known - 1;
    FAILS(STRUCT_SIZE, umo_model_get_info(model, &info.known));
    info.known.struct_size = 0;
    FAILS(STRUCT_SIZE, umo_model_get_info(model, &info.known));
}

int main(int argc, char **argv) {
    CHECK(argc == 2);
    CHECK(umo_abi_version() == UMO_ABI_VERSION);
    umo_model *model = load_model(argv[1]);
    structures_grow(model);
    OK(umo_model_free(model));
    return 0;
}
