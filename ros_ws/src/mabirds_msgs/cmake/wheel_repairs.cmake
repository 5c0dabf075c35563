# Repairs for ROS installed from pip wheels. Include before any find_package.

# 1. The wheels' exported targets name include directories of the machine that built the wheels
#    (/opt/python/...). Drop those that do not exist here, once all targets are known.
function(drop_missing_include_directories)
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(directories ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(directories)
      set(existing)
      foreach(directory IN LISTS directories)
        if(NOT directory MATCHES "^/opt/python/" OR EXISTS "${directory}")
          list(APPEND existing "${directory}")
        endif()
      endforeach()
      set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${existing}")
    endif()
  endforeach()
endfunction()
cmake_language(DEFER DIRECTORY "${CMAKE_SOURCE_DIR}" CALL drop_missing_include_directories)

# 2. rosidl looks its resources up in AMENT_PREFIX_PATH, which pip does not set: it is the prefix
#    (virtual environment or pip's build overlay) that holds ament_cmake_core.
if("$ENV{AMENT_PREFIX_PATH}" STREQUAL "")
  find_package(ament_cmake_core REQUIRED)
  get_filename_component(wheel_prefix "${ament_cmake_core_DIR}/../../.." ABSOLUTE)
  set(ENV{AMENT_PREFIX_PATH} "${wheel_prefix}")
endif()
