# Overlay port for this repository: vcpkg install umo --overlay-ports=packaging/vcpkg
# Builds with Cargo, which must be in the PATH, and downloads the Rust crates of Cargo.lock.

get_filename_component(SOURCE_PATH "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
if(NOT EXISTS "${SOURCE_PATH}/scripts/build/install")
  message(FATAL_ERROR "${PORT}: ${SOURCE_PATH} is not umo's repository: use this port as an overlay from there")
endif()
find_program(CARGO cargo PATHS "$ENV{HOME}/.cargo/bin" REQUIRED)
get_filename_component(CARGO_DIR "${CARGO}" DIRECTORY)

# One optimised build: its interface is C, so programs of both configurations can use it.
set(VCPKG_BUILD_TYPE release)

vcpkg_execute_required_process(
  COMMAND "${CMAKE_COMMAND}" -E env "PATH=${CARGO_DIR}:$ENV{PATH}"
          "CARGO_TARGET_DIR=${CURRENT_BUILDTREES_DIR}/${TARGET_TRIPLET}-target"
          bash "${SOURCE_PATH}/scripts/build/install" --prefix "${CURRENT_PACKAGES_DIR}"
  WORKING_DIRECTORY "${SOURCE_PATH}"
  LOGNAME "install-${TARGET_TRIPLET}")

# Keep only the library that the triplet selects.
if(VCPKG_LIBRARY_LINKAGE STREQUAL "static")
  file(GLOB UNWANTED "${CURRENT_PACKAGES_DIR}/lib/libumo.so*" "${CURRENT_PACKAGES_DIR}/lib/libumo*.dylib")
else()
  set(UNWANTED "${CURRENT_PACKAGES_DIR}/lib/libumo.a")
endif()
file(REMOVE ${UNWANTED})

vcpkg_cmake_config_fixup(CONFIG_PATH lib/cmake/umo)
vcpkg_fixup_pkgconfig()
file(GLOB LICENCES "${CURRENT_PACKAGES_DIR}/share/licenses/umo/*")
vcpkg_install_copyright(FILE_LIST ${LICENCES})
file(REMOVE_RECURSE "${CURRENT_PACKAGES_DIR}/share/licenses")
file(INSTALL "${CMAKE_CURRENT_LIST_DIR}/usage" DESTINATION "${CURRENT_PACKAGES_DIR}/share/${PORT}")
