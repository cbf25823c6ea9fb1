#!/bin/sh
# SPDX-License-Identifier: GPL-3.0-or-later
# Runs Skytree's CUDA tests, NVIDIA's checkers and the benchmarks on this machine's GPU, with nothing
# installed but NVIDIA's driver. A step that fails or takes too long does not stop the others.
#
#   ./check.sh [FOLDER FOR RESULTS] [STEP ...]      steps: machine tests python memcheck racecheck initcheck
#                                                   synccheck samplers renders figures (default: all, in this order)
here=$(cd "$(dirname "$0")" && pwd)
out=${1:-$here/results}
[ $# -gt 0 ] && shift
mkdir -p "$out/figures" || exit 1
out=$(cd "$out" && pwd)
steps=${*:-machine tests python memcheck racecheck initcheck synccheck samplers renders figures}

export PYTHONHOME="$here/python" PYTHONPATH="$here/python/packages" PYTHONDONTWRITEBYTECODE=1 PYTHONUNBUFFERED=1
export LD_LIBRARY_PATH="$here/lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}" SKYTREE_SHARED="$here/shared"
export MPLCONFIGDIR="$out/matplotlib"
python=$here/python/bin/python3
tests="env SKYTREE_EMBREE=$(ls "$PYTHONPATH"/skytree_core/lib/*embree3*) $here/bin/skytree_tests"
few=--gtest_filter=@FEW@

# step SECONDS COMMAND …: its output in a log, and one line about how it ended.
step() {
  seconds=$1
  shift
  started=$(date +%s)
  timeout -k 10 "$seconds" "$@" >"$out/$name.log" 2>&1 </dev/null
  code=$?
  echo "$name: exit code $code after $(($(date +%s) - started)) s" | tee -a "$out/summary.txt"
  [ $code -eq 0 ] || tail -n 12 "$out/$name.log" | sed 's/^/    /'
}

checker=$(command -v compute-sanitizer || ls /usr/local/cuda/bin/compute-sanitizer 2>/dev/null)
for name in $steps; do
  case $name in
    machine) step 30 sh -c 'nvidia-smi; uname -a; ldd --version | head -n 1; nvcc --version' ;;
    tests) step 240 $tests --gtest_filter='Cuda*:*/Cuda*' "--gtest_output=xml:$out/tests.xml" ;;
    python) step 120 "$python" -m pytest -p no:cacheprovider "--junitxml=$out/python.xml" "$here/native/python/tests/test_cuda.py" ;;
    samplers) step 150 "$python" "$here/docs/bench/cuda_samplers.py" --nvcc= --csv "$out/cuda_samplers.csv" --page "$out/cuda_samplers.md" ;;
    renders) step 60 "$python" "$here/docs/bench/cuda_render.py" --map "$(ls "$here"/shared/hdri/*uffizi* "$here"/shared/hdri/courtyard.exr 2>/dev/null | head -n 1)" ;;
    figures) step 200 "$python" "$here/docs/make_figures/make_figures.py" --only figure4 figure5 --out "$out/figures" ;;
    *check)
      if [ -n "$checker" ]; then
        step 120 "$checker" --tool "$name" --error-exitcode 9 $tests "$few"
      else
        echo "$name: left out, compute-sanitizer was not found" | tee -a "$out/summary.txt"
      fi ;;
    *) echo "there is no step $name"; exit 2 ;;
  esac
done
