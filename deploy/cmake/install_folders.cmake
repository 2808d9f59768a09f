# SPDX-License-Identifier: Apache-2.0
# For scripts that `cmake --install` runs. CMake makes folders by the umask of whoever installs; services read what is in
# them as another user. Those that are there already are left as they are, but not in a tree that is only staged (DESTDIR).
function(etude_make_folders)  # absolute paths, parents first
  foreach(path IN LISTS ARGN)
    set(folder "$ENV{DESTDIR}${path}")
    if(NOT EXISTS "${folder}" OR NOT "$ENV{DESTDIR}" STREQUAL "")
      file(MAKE_DIRECTORY "${folder}")
      file(CHMOD "${folder}" DIRECTORY_PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE
           WORLD_READ WORLD_EXECUTE)
    endif()
  endforeach()
endfunction()
