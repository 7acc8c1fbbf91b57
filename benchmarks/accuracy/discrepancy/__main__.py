from benchmarks.accuracy.discrepancy.score import main

if __name__ == "__main__":
    main()
