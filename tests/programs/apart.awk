# Fails where the true joint positions of two tables of signals differ by more than `apart`, or one is longer by more than a hundred ticks.
BEGIN { FS = ","; most = ENVIRON["apart"] }
FNR == 1 { file++; split("", q); for (i = 1; i <= NF; i++) if ($i ~ /^joint\.q\.[0-9]+$/) q[i]; next }
file == 1 { for (i in q) kept[FNR, i] = $i; n = FNR }
file == 2 && FNR <= n { for (i in q) { d = $i - kept[FNR, i]; if (d > most || d < -most) { print FNR, i, d; exit code = 1 } } m = FNR; end = FNR }
file == 2 { m = FNR }
END { if (code || n < 100 || m - n > 100 || n - m > 100) { print n, m; exit 1 } }
