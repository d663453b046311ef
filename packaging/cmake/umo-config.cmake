# find_package(umo) defines the targets umo::umo, the shared library (the static one if no shared one is installed), and
# umo::static, and the variable umo_MODEL_DIR.

# Search upwards for the header, since packagers move this file. Resolve symbolic links, for systems where /lib is one.
get_filename_component(_umo_prefix "${CMAKE_CURRENT_LIST_DIR}" REALPATH)
foreach(_umo_step RANGE 1 4)
  get_filename_component(_umo_prefix "${_umo_prefix}" DIRECTORY)
  if(EXISTS "${_umo_prefix}/include/umo.h")
    break()
  endif()
endforeach()
if(NOT EXISTS "${_umo_prefix}/include/umo.h")
  set(umo_FOUND FALSE)
  set(umo_NOT_FOUND_MESSAGE "include/umo.h was not found in any folder above ${CMAKE_CURRENT_LIST_DIR}")
  return()
endif()
set(umo_MODEL_DIR "${_umo_prefix}/share/umo/models")

set(_umo_implib "")
set(_umo_static "${_umo_prefix}/lib/libumo.a")
set(_umo_native "${CMAKE_DL_LIBS};m")
if(WIN32)
  # MinGW's linker accepts MSVC's import library, but not the other way round. The static library is for MinGW only.
  set(_umo_native ntdll userenv ws2_32)
  if(MSVC)
    set(_umo_static "${_umo_prefix}/lib/umo.lib")
  endif()
  set(_umo_shared "${_umo_prefix}/bin/umo.dll")
  set(_umo_implib "${_umo_prefix}/lib/umo.dll.lib")
elseif(APPLE)
  set(_umo_shared "${_umo_prefix}/lib/libumo.dylib")
elseif(ANDROID)
  set(_umo_shared "${_umo_prefix}/jniLibs/${ANDROID_ABI}/libumo.so")
else()
  set(_umo_shared "${_umo_prefix}/lib/libumo.so")
endif()

if(EXISTS "${_umo_static}" AND NOT TARGET umo::static)
  include(CMakeFindDependencyMacro)
  find_dependency(Threads)
  add_library(umo::static STATIC IMPORTED)
  set_target_properties(umo::static PROPERTIES
    IMPORTED_LOCATION "${_umo_static}"
    INTERFACE_INCLUDE_DIRECTORIES "${_umo_prefix}/include"
    INTERFACE_COMPILE_DEFINITIONS UMO_STATIC
    INTERFACE_LINK_LIBRARIES "Threads::Threads;${_umo_native}")
endif()

if(NOT TARGET umo::umo)
  if(EXISTS "${_umo_shared}")
    add_library(umo::umo SHARED IMPORTED)
    set_target_properties(umo::umo PROPERTIES
      IMPORTED_LOCATION "${_umo_shared}"
      INTERFACE_INCLUDE_DIRECTORIES "${_umo_prefix}/include")
    if(_umo_implib)
      set_target_properties(umo::umo PROPERTIES IMPORTED_IMPLIB "${_umo_implib}")
    endif()
  elseif(TARGET umo::static)
    add_library(umo::umo INTERFACE IMPORTED)
    set_target_properties(umo::umo PROPERTIES INTERFACE_LINK_LIBRARIES umo::static)
  else()
    set(umo_FOUND FALSE)
    set(umo_NOT_FOUND_MESSAGE "neither ${_umo_shared} nor ${_umo_static} exists")
  endif()
endif()

foreach(_umo_variable prefix step shared implib static native)
  unset(_umo_${_umo_variable})
endforeach()
