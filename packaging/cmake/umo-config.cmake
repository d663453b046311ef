# find_package(umo) gives the targets umo::umo, the shared library, and umo::static, and the variable umo_MODEL_DIR.

get_filename_component(_umo_prefix "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
set(umo_MODEL_DIR "${_umo_prefix}/share/umo/models")

find_package(Threads QUIET)

if(NOT TARGET umo::umo)
  add_library(umo::umo SHARED IMPORTED)
  set_target_properties(umo::umo PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${_umo_prefix}/include")
  if(WIN32)
    set_target_properties(umo::umo PROPERTIES
      IMPORTED_LOCATION "${_umo_prefix}/bin/umo.dll"
      IMPORTED_IMPLIB "${_umo_prefix}/lib/umo.dll.lib")
  elseif(APPLE)
    set_target_properties(umo::umo PROPERTIES IMPORTED_LOCATION "${_umo_prefix}/lib/libumo.dylib")
  else()
    set_target_properties(umo::umo PROPERTIES IMPORTED_LOCATION "${_umo_prefix}/lib/libumo.so")
  endif()
endif()

if(NOT WIN32 AND NOT TARGET umo::static)
  add_library(umo::static STATIC IMPORTED)
  set_target_properties(umo::static PROPERTIES
    IMPORTED_LOCATION "${_umo_prefix}/lib/libumo.a"
    INTERFACE_INCLUDE_DIRECTORIES "${_umo_prefix}/include"
    INTERFACE_COMPILE_DEFINITIONS UMO_STATIC
    INTERFACE_LINK_LIBRARIES "Threads::Threads;${CMAKE_DL_LIBS};m")
endif()

set(umo_FOUND TRUE)
